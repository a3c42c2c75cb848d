"""Whether a robot's frame has moved: by the corrections of its pose that several cameras ask for.

Where a camera and a robot disagree, either may be wrong. Only a second camera can tell: if two cameras that see the same robot
ask for the same correction, the robot's frame is wrong; if only one does and another agrees with the robot, that camera is.
Where it is two against one, it can't be told yet.
Cameras that are wrong by themselves, but in the same way, don't happen.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from surveilnav.robot_frame.planar import PlanarTransform

#: Smaller corrections can't be told from noise: of healthy robots, up to 0.18 m and 1.2 degrees were found.
LARGE_M, LARGE_RAD = 0.25, math.radians(2.5)
#: Corrections by two cameras are the same within these.
_SAME_M, _SAME_RAD = 0.25, math.radians(3.0)
#: A robot is believed again after so many comparisons in a row in which some camera agrees and none disagrees.
_MIN_AGREEING = 2


def is_large(correction: PlanarTransform, p_robot: ArrayLike) -> bool:
    """Whether a correction of where a robot at (2,) [m, building] stands is more than noise."""
    off_m, off_rad = correction.difference(PlanarTransform(), p_robot)
    return off_m >= LARGE_M or off_rad >= LARGE_RAD


@dataclass(slots=True)
class DriftMonitor:
    """The newest comparison of one robot's frame with each camera.

    Attributes:
        corrections: by camera that disagrees, the correction that it asks for (``T_building_reported``): takes a point as the
            robot reports it to where the camera has measured it.
        agreeing: cameras that agree with the robot.
        correction: of a robot whose frame is known to be wrong, the correction; None: it isn't known to be.
        witnesses: the cameras that ask for this correction.
    """

    corrections: dict[str, PlanarTransform] = field(default_factory=dict)
    agreeing: set[str] = field(default_factory=set)
    correction: PlanarTransform | None = None
    witnesses: tuple[str, ...] = ()
    _n_agreeing: int = 0

    def record(self, answers: Mapping[str, PlanarTransform | None], p_robot: ArrayLike) -> None:
        """Records one comparison.

        Args:
            answers: by camera that could be compared, the correction that it asks for; None: it agrees with the robot.
            p_robot: (2,) the robot's position as it reports it [m, building].
        """
        for camera, correction in answers.items():
            self._drop(camera)
            if correction is None:
                self.agreeing.add(camera)
            else:
                self.corrections[camera] = correction
        if self.correction is None:
            self._find_consensus(p_robot)
        elif answers:
            disagreeing = any(correction is not None for correction in answers.values())
            self._n_agreeing = 0 if disagreeing else self._n_agreeing + 1
            if self._n_agreeing >= _MIN_AGREEING:
                self.correction, self.witnesses, self._n_agreeing = None, (), 0
                self.corrections = {}
            elif disagreeing:
                self._find_consensus(p_robot)  # it may have moved farther

    def is_contradicted_by(self, camera: str, p_robot: ArrayLike) -> bool:
        """Whether this camera is the one that is wrong: no other asks for its correction, and another agrees with the robot."""
        own = self.corrections.get(camera)
        if own is None or self.correction is not None or not self.agreeing:
            return False
        return not any(name != camera and _is_same(own, T, p_robot) for name, T in self.corrections.items())

    def forget(self, camera: str) -> None:
        """Forgets a camera's answers, for good. A frame that fewer than two cameras still call wrong isn't known to be."""
        self._drop(camera)
        self.witnesses = tuple(name for name in self.witnesses if name != camera)
        if len(self.witnesses) < 2:
            self.correction, self.witnesses, self._n_agreeing = None, (), 0

    def _drop(self, camera: str) -> None:
        self.agreeing.discard(camera)
        self.corrections.pop(camera, None)

    def restart(self) -> None:
        """Forgets the answers about a frame that the robot has no more. A known error stays known until cameras agree."""
        self.corrections, self.agreeing, self._n_agreeing = {}, set(), 0

    def state(self) -> dict[str, Any]:
        """Everything as plain values, for ``from_state``."""
        return {
            "corrections": [[name, T.x_m, T.y_m, T.yaw_rad] for name, T in sorted(self.corrections.items())],
            "agreeing": sorted(self.agreeing),
            "correction": [self.correction.x_m, self.correction.y_m, self.correction.yaw_rad]
            if self.correction
            else [],
            "witnesses": list(self.witnesses),
            "n_agreeing": self._n_agreeing,
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> DriftMonitor:
        return cls(
            {name: PlanarTransform(*values) for name, *values in state["corrections"]},
            set(state["agreeing"]),
            PlanarTransform(*state["correction"]) if state["correction"] else None,
            tuple(state["witnesses"]),
            state["n_agreeing"],
        )

    def _find_consensus(self, p_robot: ArrayLike) -> None:
        """Finds the correction that most cameras ask for, if two do, and more than twice as many as agree with the robot."""
        best: tuple[str, ...] = ()
        for T in self.corrections.values():
            same = tuple(sorted(name for name, other in self.corrections.items() if _is_same(T, other, p_robot)))
            best = max(best, same, key=len)
        if len(best) >= 2 and len(best) > 2 * len(self.agreeing):
            self.correction, self.witnesses = _mean([self.corrections[name] for name in best], p_robot), best


def _is_same(one: PlanarTransform, other: PlanarTransform, p_robot: ArrayLike) -> bool:
    off_m, off_rad = one.difference(other, p_robot)
    return off_m <= _SAME_M and off_rad <= _SAME_RAD


def _mean(corrections: list[PlanarTransform], p_robot: ArrayLike) -> PlanarTransform:
    """The mean of corrections that differ little: of their angles, and of where they put the robot."""
    n = len(corrections)
    first = corrections[0].yaw_rad
    yaw_rad = first + sum(math.remainder(T.yaw_rad - first, 2 * math.pi) for T in corrections) / n
    x, y = sum(T.apply(p_robot) for T in corrections) / n - PlanarTransform(0.0, 0.0, yaw_rad).apply(p_robot)
    return PlanarTransform(float(x), float(y), yaw_rad)
