"""An option: something that the robot could do next, with what it is expected to bring and to cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from surveilnav.messages import Candidate, ObjectRecord, Stair

if TYPE_CHECKING:
    from surveilnav.services.planner.core.context import StepContext
    from surveilnav.services.planner.core.goals.frontiers import Frontier
    from surveilnav.services.planner.core.memory.floor_goal import FloorGoal
    from surveilnav.services.planner.core.motion.areas import Area

OptionKind = Literal["target", "candidate", "frontier", "stairs", "second_look", "passage"]


@dataclass(frozen=True, slots=True)
class Option:
    """Something that the robot could do next.

    Attributes:
        kind: "target": go to an object that is confirmed as the target; "candidate": to one that may be it; "frontier": explore;
            "stairs": go to another floor; "second_look": look all around; "passage": wait until it opens.
        x_m, y_m: where [m, world].
        chance: that the target is found there, 0 to 1.
        cost_m: the expected way until then, in metres: the travel time there, and what looking or exploring there takes.
            ``spend_m``: the latter alone.
        utility: what options are compared by; ``chance / cost_m``, but for the exceptions in ``options/__init__.py``.
        why: for people.
        record: the object. ``frontier``, ``stairs`` with ``floor_goal``, ``passages``: what the other kinds are about.
        is_current: the robot is heading for it already.
        is_fallback: it is a look around, a wait or a last resort: to turn to it is no oscillation.
        is_accepted: the object is taken for the target on weaker evidence, unless the robot's views contradict that.
    """

    kind: OptionKind
    x_m: float
    y_m: float
    chance: float
    cost_m: float
    utility: float
    why: str
    record: ObjectRecord | None = None
    frontier: Frontier | None = None
    stairs: Stair | None = None
    floor_goal: FloorGoal | None = None
    passages: tuple[Area, ...] = ()
    is_current: bool = False
    is_fallback: bool = False
    is_accepted: bool = False
    spend_m: float = 0.0

    def to_candidate(self, *, chosen: bool) -> Candidate:
        """The option as people are shown it."""
        kind = self.kind
        assert kind != "passage"
        object_id = self.record.id if self.record else None
        return Candidate(
            kind, self.x_m, self.y_m, self.utility, chosen, self.why[:120], object_id, self.chance, self.cost_m
        )


Proposer = Callable[["StepContext"], list[Option]]
"""Proposes options. It changes nothing."""
