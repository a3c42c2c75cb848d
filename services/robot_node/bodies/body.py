"""What a robot node knows of its robot, whatever moves it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.messages import Stair
from surveilnav.sensing.views import TrueInstances
from surveilnav.services.robot_node.core import RobotState


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What a robot saw in one state.

    Attributes:
        state: where it stood, and what it had done.
        T_world_camera: (4, 4) of its camera then.
        camera: intrinsics of both pictures (registered).
        mounting_offset_m: height of the camera above the floor.
        depth_range_m: (nearest, farthest) that it measures.
        rgb: (height, width, 3) uint8.
        depth_m: (height, width) float32 [m] along the optical axis; 0 or NaN where there is none.
        truth: what each pixel shows: a simulator knows, a real robot never does.
    """

    state: RobotState
    T_world_camera: Matrix4
    camera: Pinhole
    mounting_offset_m: float
    depth_range_m: tuple[float, float]
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    truth: TrueInstances | None = None


class Body(Protocol):
    """One robot. Commands and looks come from two threads; commands never overlap.

    ``stairs``: those that it can take, in both directions. ``notes``: what people should know of where it can go.
    """

    stairs: Sequence[Stair]
    notes: Sequence[str]

    @property
    def state(self) -> RobotState:
        """Where it is, and what it did last."""
        ...

    def refusal(self, action: str, to_floor: str | None = None) -> str:
        """Why it can't carry out an action at all, for people; empty if it can."""
        ...

    def begin_mission(self, mission: str) -> None:
        """Counts path and steps from here on; ``state`` names the mission."""
        ...

    def act(self, action: str, to_floor: str | None = None) -> None:
        """Carries out one action to its end; ask ``refusal`` first."""
        ...

    def halt(self) -> None:
        """Stops moving at once, also in the middle of an action, which then ends where it is. Comes from a third thread."""
        ...

    def observe(self) -> Look:
        """What it sees now."""
        ...
