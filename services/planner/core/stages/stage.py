"""What a stage is: it tries one kind of waypoint."""

from __future__ import annotations

from typing import Protocol

from surveilnav.services.planner.core.context import StepContext
from surveilnav.services.planner.core.decision import Decision


class Retry:
    """A stage changed what the choice depends on, by abandoning a waypoint for example. So the round begins again."""


RETRY = Retry()


class Stage(Protocol):
    """Chooses a waypoint of its kind and drives there."""

    __name__: str

    def __call__(self, context: StepContext) -> Decision | Retry | None:
        """The next action; ``RETRY`` to begin the round again; None: there is no waypoint of this kind."""
