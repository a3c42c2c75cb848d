"""What a stage is: one kind of waypoint, tried."""

from __future__ import annotations

from typing import Protocol

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.state import Decision


class Retry:
    """A stage gave a waypoint up, or ended a wait: what is known changed, so the choice begins again."""


RETRY = Retry()


class Stage(Protocol):
    """Chooses a waypoint of its kind and drives there."""

    __name__: str

    def __call__(self, context: StepContext) -> Decision | Retry | None:
        """The next action; ``RETRY``; None: there is no waypoint of this kind."""
