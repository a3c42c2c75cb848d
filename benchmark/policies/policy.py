"""What a policy is: a way to search on the joint maps, and the settings of the maps that it is defined with."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol

from surveilnav.benchmark.policies.language_model import LanguageModel
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import Decision, FloorMaps, RobotView
from surveilnav.services.planner.core.motion.drive import LocalPlanner
from surveilnav.simulator.world.goals import Goals
from surveilnav.simulator.world.navigation import NavigationMap


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The simulator's own truth, which only upper bounds may see."""

    goals: Goals
    navigation: NavigationMap


@dataclass(frozen=True, slots=True, eq=False)
class Task:
    """What a searcher is told when an episode begins.

    ``seed``: this episode's, the only source of chance. ``driver``: drives to goal cells (fmm or sp). ``truth``: None
    unless the policy ``needs_truth``. ``language_model``: None unless it ``needs_language_model``. ``goal_on_floor``: it
    begins on a floor with a goal, which everybody may know. ``planning``: settings of the planner's core to change, for
    policies made of it.
    """

    target: str
    seed: int
    max_steps: int
    driver: LocalPlanner
    truth: Truth | None = None
    language_model: LanguageModel | None = None
    goal_on_floor: bool = False
    planning: Mapping[str, Any] = field(default_factory=dict)


class Searcher(Protocol):
    """One episode of a policy."""

    @property
    def steps(self) -> int:
        """Actions decided so far; a stair counts as many as moves of its length."""

    def act(self, maps: FloorMaps, robot: RobotView, summaries: Mapping[str, Mapping[str, float]]) -> Decision:
        """The next action, see ``surveilnav.services.planner.core.step``. Not to be called again once ``finished``.

        Args:
            maps: the joint maps of the robot's floor.
            robot: the robot at the observation that they end with.
            summaries: by floor, label -> highest confidence that its cameras last reported; empty without any.
        """


@dataclass(frozen=True, slots=True)
class Policy:
    """A named way to search.

    Attributes:
        name: as on the command line. ``about``: one line with the paper's link.
        begin: a fresh searcher for an episode.
        fusion: the joint maps' settings that it is defined with.
        needs_truth: it is no method but a bound: it sees the ``Truth``.
        needs_language_model: it asks one, so a server has to be named.
    """

    name: str
    about: str
    begin: Callable[[Task], Searcher]
    fusion: FusionConfig
    needs_truth: bool = False
    needs_language_model: bool = False
