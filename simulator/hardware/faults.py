"""What can go wrong with a real robot, for tests of what SurveilNav then does and says. Nothing goes wrong by default."""

from __future__ import annotations

import os
from collections.abc import Collection
from typing import Literal

from surveilnav.simulator.world.simulated_nav2 import NavigationGoal, SimulatedNav2

FaultName = Literal[
    "goal_rejected",  # Nav2 takes no goal
    "goal_aborted",  # Nav2 gives a goal up
    "wheels_blocked",  # the robot stands, and Nav2 gives up by itself
    "localisation_lost",  # no corrections and no map -> odom any more
    "feedback_stops",
    "node_dies",  # the process ends at once
    "no_depth",
    "depth_mm_as_metres",  # depth is in millimetres, and is called 32FC1, which means metres
    "no_tf",
    "tf_static_volatile",  # who listens later doesn't hear of the camera's frames
]


class Faults:
    """The faults of one robot. Those during a goal happen ``after_s`` after it was accepted."""

    def __init__(self, names: Collection[FaultName], after_s: float) -> None:
        self._names, self._after_s = frozenset(names), after_s

    @property
    def rejects_goals(self) -> bool:
        return "goal_rejected" in self._names

    @property
    def no_depth(self) -> bool:
        return "no_depth" in self._names

    @property
    def depth_mm_as_metres(self) -> bool:
        return "depth_mm_as_metres" in self._names

    @property
    def no_tf(self) -> bool:
        return "no_tf" in self._names

    @property
    def tf_static_volatile(self) -> bool:
        return "tf_static_volatile" in self._names

    def withholds_feedback(self, goal: NavigationGoal) -> bool:
        return "feedback_stops" in self._names and goal.elapsed_s >= self._after_s

    def apply(self, nav2: SimulatedNav2, goal: NavigationGoal) -> None:
        """Has happen what is due during a goal."""
        if goal.elapsed_s < self._after_s:
            return
        if "goal_aborted" in self._names:
            nav2.abort(goal, "a fault that was asked for")
        if "wheels_blocked" in self._names:
            nav2.robot.held = True
        if "localisation_lost" in self._names:
            nav2.robot.localisation.lost = True
        if "node_dies" in self._names:
            os._exit(1)
