"""Rules that choose one of several options: ours and the paper's."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.options.option import Option, OptionKind

ChoiceRule = Callable[[Sequence[Option], StepContext], Option]

_PAPERS_ORDER: tuple[OptionKind, ...] = ("target", "candidate", "stairs", "frontier", "second_look", "passage")


def highest_utility(options: Sequence[Option], context: StepContext) -> Option:
    """Ours: the highest chance per expected metre. The current option is kept unless another is clearly better (hysteresis).

    For options that lie apart like spokes, taking them by chance per cost finds the target on the shortest expected way
    (Smith's rule, https://doi.org/10.1002/nav.3800030106).
    """
    best = max(options, key=lambda option: option.utility)
    current = max((o for o in options if o.is_current), key=lambda option: option.utility, default=None)
    return current if current and best.utility <= context.config.switch_ratio * current.utility else best


def papers_order(options: Sequence[Option], context: StepContext) -> Option:
    """The paper's (section IV-E): a confirmed target, else a promising candidate, else the best frontier; other floors, of which
    it doesn't speak, before frontiers."""
    first = min((o.kind for o in options if not o.is_accepted), key=_PAPERS_ORDER.index, default=None)
    return highest_utility([o for o in options if o.is_accepted or o.kind == first], context)
