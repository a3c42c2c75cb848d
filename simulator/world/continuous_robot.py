"""A robot with two driven wheels that moves continuously: velocities in, arcs out, and an estimate of its own of where it is.

It is a disc, as in ``NavigationMap``: contact ends a movement, but not a turn on the spot. There is no clock here; ``advance`` is
told how much time passes. The same seed and the same calls give the same movements.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_state import RobotState
from surveilnav.simulator.world.geodesic import first_blocked
from surveilnav.simulator.world.localisation import Localisation, LocalisationSettings
from surveilnav.simulator.world.navigation import NavigationMap

#: The robot stops this far before a contact, so that it never stands in the blocked cell itself.
_CLEARANCE_M = 1e-3
#: An arc is tested for contact along chords that are at most this long, in cells, and turn by at most this angle.
_CHORD_CELLS = 0.5
_CHORD_RAD = 0.1


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What the robot's drive can do.

    ``command_timeout_s``: a velocity command older than this counts no longer, and the robot brakes.
    """

    speed_m_s: float = 0.5
    turn_rate_rad_s: float = 1.2
    acceleration_m_s2: float = 1.0
    turn_acceleration_rad_s2: float = 4.0
    command_timeout_s: float = 0.5


@dataclass(frozen=True, slots=True)
class _Command:
    speed_m_s: float
    turn_rate_rad_s: float
    given_s: float


class ContinuousRobot:
    """One robot.

    Attributes:
        localisation: where it believes it is.
        time_s: since it started, the sum of what ``advance`` was told.
        speed_m_s, turn_rate_rad_s: now.
        collided: whether the last ``advance`` ended at a contact.
        held: its wheels are blocked (somebody holds it, its emergency button is pressed); it doesn't move while this is set.
    """

    def __init__(
        self,
        navigation: NavigationMap,
        start: RobotState,
        *,
        limits: MotionLimits | None = None,
        localisation: LocalisationSettings | None = None,
        seed: int = 0,
    ) -> None:
        """``start`` must be free ground. Its path counts on."""
        self.navigation, self.limits = navigation, limits or MotionLimits()
        self.time_s = self.speed_m_s = self.turn_rate_rad_s = 0.0
        self.collided = self.held = False
        self._command: _Command | None = None
        self._override: _Command | None = None
        self._x_m = self._y_m = self._yaw_rad = self._path_m = 0.0
        self._place(start)
        self.localisation = Localisation(localisation or LocalisationSettings(), self.pose, seed)

    @property
    def state(self) -> RobotState:
        """Where it is in truth, how far it has driven, and whether it has just collided."""
        return replace(
            self._start,
            x_m=self._x_m,
            y_m=self._y_m,
            yaw_rad=math.remainder(self._yaw_rad, 2 * math.pi),
            path_m=self._path_m,
            collided=self.collided,
        )

    @property
    def floor(self) -> str:
        return self._start.floor

    @property
    def pose(self) -> PlanarTransform:
        """``T_building_base``: where it is in truth."""
        return PlanarTransform(self._x_m, self._y_m, self._yaw_rad)

    def command(self, speed_m_s: float, turn_rate_rad_s: float) -> None:
        """Drives at this speed (negative: backwards) and turns at this rate, within its limits, until ``command_timeout_s``."""
        self._command = _Command(speed_m_s, turn_rate_rad_s, self.time_s)

    def override(self, speed_m_s: float, turn_rate_rad_s: float) -> None:
        """As ``command``, and takes precedence over it: a person's, or another program's, while the robot navigates."""
        self._override = _Command(speed_m_s, turn_rate_rad_s, self.time_s)

    def carry_to(self, state: RobotState) -> None:
        """Puts it somewhere else, as a lift or a person would: wheels notice nothing, and the next correction finds it there."""
        self._place(replace(state, path_m=self._path_m))
        self.speed_m_s = self.turn_rate_rad_s = 0.0

    def jump(self, dx_m: float, dy_m: float, dyaw_rad: float = 0.0) -> None:
        """Has its localisation jump, see ``Localisation.jump``."""
        self.localisation.jump(dx_m, dy_m, dyaw_rad, self.pose)

    def restart_odometry(self, *, new_map: bool) -> None:
        """Has its odometry begin anew here, see ``Localisation.restart``."""
        self.localisation.restart(self.pose, new_map=new_map)

    def advance(self, dt_s: float) -> None:
        """Lets time pass. Velocities change once, at the beginning, as far as they can in ``dt_s``; so steps of 0.05 s or less
        accelerate smoothly. The movement is the exact arc of these velocities, up to the first contact."""
        speed, turn_rate = self._accelerate(dt_s)
        distance_m, turn_rad = speed * dt_s, turn_rate * dt_s
        self.collided = False
        if distance_m:
            distance_m = self._drive(distance_m, turn_rad)
        self._yaw_rad += turn_rad
        self.time_s += dt_s
        self._path_m += abs(distance_m)
        self.localisation.update(distance_m, turn_rad, self.pose, self.time_s)

    def _accelerate(self, dt_s: float) -> tuple[float, float]:
        limits = self.limits
        if self.held:
            self.speed_m_s = self.turn_rate_rad_s = 0.0
            return 0.0, 0.0
        speed, turn_rate = self._commanded()
        self.speed_m_s = _approach(self.speed_m_s, speed, limits.speed_m_s, limits.acceleration_m_s2 * dt_s)
        self.turn_rate_rad_s = _approach(
            self.turn_rate_rad_s, turn_rate, limits.turn_rate_rad_s, limits.turn_acceleration_rad_s2 * dt_s
        )
        return self.speed_m_s, self.turn_rate_rad_s

    def _commanded(self) -> tuple[float, float]:
        """Speed and turn rate of the override, or of the command; 0 if there is none that still counts."""
        for command in (self._override, self._command):
            if command is not None and self.time_s - command.given_s <= self.limits.command_timeout_s + 1e-9:
                return command.speed_m_s, command.turn_rate_rad_s
        return 0.0, 0.0

    def _drive(self, distance_m: float, turn_rad: float) -> float:
        """Moves along an arc, up to a contact, and returns how far it came [m]."""
        grid = self._ground.grid
        scale = 1.0 / grid.resolution_m
        row, col, share = drive_arc(
            self._ground.free,
            (self._y_m - grid.origin_y_m) * scale,
            (self._x_m - grid.origin_x_m) * scale,
            self._yaw_rad,
            distance_m * scale,
            turn_rad,
            _CLEARANCE_M * scale,
        )
        self._x_m, self._y_m = grid.origin_x_m + col / scale, grid.origin_y_m + row / scale
        if share < 1.0:
            self.collided, self.speed_m_s = True, 0.0
        return distance_m * float(share)

    def _place(self, state: RobotState) -> None:
        if not self.navigation.is_navigable(state.p_world, state.floor):
            raise ValueError(f"a robot can't stand at ({state.x_m:.2f}, {state.y_m:.2f}) on floor {state.floor!r}")
        self._start, self._ground = state, self.navigation.floors[state.floor]
        self._x_m, self._y_m, self._yaw_rad, self._path_m = state.x_m, state.y_m, state.yaw_rad, state.path_m


def _approach(now: float, wanted: float, limit: float, most: float) -> float:
    """``now``, changed towards ``wanted`` (within plus or minus ``limit``) by no more than ``most``."""
    wanted = max(-limit, min(limit, wanted))
    return wanted if abs(wanted - now) <= most + 1e-9 else now + math.copysign(most, wanted - now)


def drive_arc(
    free: NDArray[np.bool_], row: float, col: float, yaw: float, distance: float, turn: float, clearance: float
) -> tuple[float, float, float]:
    """Follows an arc from (row, col) until it has the length ``distance`` or enters a cell that isn't free.

    Coordinates and lengths in cells, as for ``first_blocked``; ``yaw`` is anticlockwise from the direction of columns.

    Returns:
        row, col: where it ends, at least ``clearance`` before a contact.
        share: of the arc, 1.0 for all of it.
    """
    chords = max(1, math.ceil(max(abs(distance) / _CHORD_CELLS, abs(turn) / _CHORD_RAD)))
    r0, c0 = row, col
    for i in range(1, chords + 1):
        turned = turn * i / chords
        half = turned / 2
        chord = distance * i / chords * (math.sin(half) / half if abs(half) > 1e-6 else 1.0 - half * half / 6)
        r1, c1 = row + chord * math.sin(yaw + half), col + chord * math.cos(yaw + half)
        contact = first_blocked(free, r0, c0, r1, c1)
        if contact <= 1.0:
            reached = max(0.0, contact - clearance / max(1e-9, math.hypot(r1 - r0, c1 - c0)))
            r, c = r0 + reached * (r1 - r0), c0 + reached * (c1 - c0)
            # Right at a corner, the place a little back may still be blocked: then it stays at the chord's beginning.
            if not free[math.floor(r), math.floor(c)]:
                r, c, reached = r0, c0, 0.0
            return r, c, (i - 1 + reached) / chords
        r0, c0 = r1, c1
    return r0, c0, 1.0
