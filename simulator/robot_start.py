"""Where a simulated robot begins."""

from __future__ import annotations

import math

import numpy as np

from surveilnav.errors import ConfigError
from surveilnav.robot_state import RobotState
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.world.goals import find_goals, sample_start


def start_state(building: SimulatedBuilding, start: str, start_for: str) -> RobotState:
    """At ``start`` (x,y,floor,yaw_deg), out of sight of the target ``start_for``, or anywhere that it can move, by the seed.

    Raises:
        ConfigError: ``start`` isn't free floor; the message says what is.
    """
    navigation, seed = building.navigation, building.settings.seed
    if start:
        return _parse_start(building, start)
    if start_for:
        goals = find_goals(building.scene, navigation, start_for, caster=building.caster)
        found = sample_start(building.scene, navigation, goals, seed=seed, caster=building.caster)
        return RobotState(*found.p_m, found.floor, found.yaw_rad)
    rng = np.random.default_rng(seed)
    floor = max(navigation.robot_area, key=lambda f: int(navigation.robot_area[f].sum()))
    return RobotState(*navigation.random_point(rng, floor), floor, float(rng.uniform(-np.pi, np.pi)))


def _parse_start(building: SimulatedBuilding, start: str) -> RobotState:
    parts = [part.strip() for part in start.split(",")]
    floors = list(building.navigation.floors)
    try:
        x_m, y_m, floor, yaw_deg = float(parts[0]), float(parts[1]), parts[2], float(parts[3])
    except (ValueError, IndexError):
        raise ConfigError(f"a start is x,y,floor,yaw_deg such as 1.5,2.0,{floors[0]},90, got {start!r}") from None
    if floor not in floors:
        raise ConfigError(f"no floor {floor!r} in {building.scene.name}; it has {floors}")
    z_m = building.navigation.floors[floor].z_m
    if not building.navigation.is_navigable((x_m, y_m, z_m), floor):
        near = building.navigation.snap((x_m, y_m, z_m), floor)
        raise ConfigError(
            f"the robot can't stand at {x_m:g},{y_m:g} on floor {floor!r}; the nearest free place is {near}"
        )
    return RobotState(x_m, y_m, z_m, floor, math.radians(yaw_deg))
