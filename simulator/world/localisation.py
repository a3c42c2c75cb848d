"""Where a robot believes it is: wheel odometry that drifts, and a localisation in the robot's own map that corrects it.

Frames as in REP-105, https://www.ros.org/reps/rep-0105.html: ``odom`` is continuous and drifts, ``map`` doesn't drift and may
jump. The localisation corrects ``T_map_odom``. ``map`` lies anywhere in the building.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from surveilnav.robot_frame import PlanarTransform


@dataclass(frozen=True, slots=True)
class LocalisationSettings:
    """How well a robot knows where it is. The default knows it exactly, in the frame of the building.

    Attributes:
        T_building_map: where the robot's map lies in the building.
        drift: by which share of the way the odometry is too long or too short; the seed says which.
        yaw_drift_rad_per_m: by how much its heading turns away with every metre driven; the seed says to which side.
        sigma_m, sigma_yaw_rad: standard deviation of the pose after a correction, each of x, y and the heading.
        period_s: time between two corrections. A robot that stands isn't corrected: it sees nothing new.
    """

    T_building_map: PlanarTransform = field(default_factory=PlanarTransform)
    drift: float = 0.0
    yaw_drift_rad_per_m: float = 0.0
    sigma_m: float = 0.0
    sigma_yaw_rad: float = 0.0
    period_s: float = 1.0


class Localisation:
    """The estimate of one robot.

    Attributes:
        T_building_map: where its map lies in the building, which the robot itself doesn't know.
        T_odom_base: by the wheels alone, since the odometry began.
        T_map_odom: by the newest correction.
        lost: it corrects nothing as long as this is set, and says so.
    """

    def __init__(self, settings: LocalisationSettings, T_building_base: PlanarTransform, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._settings, self.T_building_map = settings, settings.T_building_map
        self._drift = settings.drift * self._rng.choice((-1.0, 1.0))
        self._yaw_drift_rad_per_m = settings.yaw_drift_rad_per_m * self._rng.choice((-1.0, 1.0))
        self._offset = PlanarTransform()
        self._corrected_s, self._moved = 0.0, False
        self.lost = False
        self.T_odom_base = PlanarTransform()
        self._correct(T_building_base)

    @property
    def pose(self) -> PlanarTransform:
        """``T_map_base``: where the robot believes it is in its map."""
        return self.T_map_odom @ self.T_odom_base

    def update(self, driven_m: float, turned_rad: float, T_building_base: PlanarTransform, time_s: float) -> None:
        """After a movement along an arc: measures it, and corrects if a correction is due.

        Args:
            driven_m, turned_rad: what the wheels did; ``driven_m`` is negative backwards.
            T_building_base: where the robot is in truth.
            time_s: by the robot's clock, since it started.
        """
        if driven_m or turned_rad:
            self._moved = True
            self._measure(driven_m, turned_rad)
        if self._moved and not self.lost and time_s - self._corrected_s >= self._settings.period_s - 1e-9:
            self._corrected_s = time_s
            self._correct(T_building_base)

    def jump(self, dx_m: float, dy_m: float, dyaw_rad: float, T_building_base: PlanarTransform) -> None:
        """Believes from now on to be this far from where it would; a second jump adds to it. Corrections don't end it."""
        old = self._offset
        self._offset = PlanarTransform(old.x_m + dx_m, old.y_m + dy_m, old.yaw_rad + dyaw_rad)
        self._correct(T_building_base)

    def restart(self, T_building_base: PlanarTransform, *, new_map: bool) -> None:
        """Odometry begins here and now. ``new_map``: so does the map, as with SLAM that has no stored map."""
        self.T_odom_base = PlanarTransform()
        if new_map:
            self.T_building_map = T_building_base
        self._correct(T_building_base)

    def _measure(self, driven_m: float, turned_rad: float) -> None:
        measured_m = driven_m * (1.0 + self._drift)
        turned_rad += abs(driven_m) * self._yaw_drift_rad_per_m
        old = self.T_odom_base
        chord_m, heading_rad = chord_of(measured_m, turned_rad), old.yaw_rad + turned_rad / 2
        self.T_odom_base = PlanarTransform(
            old.x_m + chord_m * math.cos(heading_rad),
            old.y_m + chord_m * math.sin(heading_rad),
            old.yaw_rad + turned_rad,
        )

    def _correct(self, T_building_base: PlanarTransform) -> None:
        """Sets ``T_map_odom`` so that the robot believes to be where it is, but for noise and jumps."""
        self._moved = False
        sigma_m, sigma_yaw_rad = self._settings.sigma_m, self._settings.sigma_yaw_rad
        dx_m, dy_m, dyaw_rad = (float(v) for v in self._rng.normal(0.0, (sigma_m, sigma_m, sigma_yaw_rad)))
        true, offset = self.T_building_map.inverse() @ T_building_base, self._offset
        believed = PlanarTransform(
            true.x_m + offset.x_m + dx_m, true.y_m + offset.y_m + dy_m, true.yaw_rad + offset.yaw_rad + dyaw_rad
        )
        self.T_map_odom = believed @ self.T_odom_base.inverse()


def chord_of(arc_m: float, turn_rad: float) -> float:
    """Length of the straight line between the ends of an arc on which the heading turns by ``turn_rad`` [m]."""
    half = turn_rad / 2
    return arc_m * (math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6)
