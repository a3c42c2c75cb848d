"""The three ways of ``surveilnav robots frame``: from files, and for one of them from a running system."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import typer
from numpy.typing import NDArray

from surveilnav.building_file import load_building
from surveilnav.camera_pose.tag import load_sightings
from surveilnav.cameras_file import load_cameras
from surveilnav.cli.options import gateway
from surveilnav.errors import ConfigError
from surveilnav.geometry import Grid
from surveilnav.robot_file import RobotFile
from surveilnav.robot_frame import (
    FoundFrame,
    PlanarTransform,
    from_point_pairs,
    load_nav2_map,
    match_maps,
)
from surveilnav.robot_frame.nav2_map import OCCUPIED, UNKNOWN
from surveilnav.robot_frame.tag import from_tag

_CELL_M = 0.05  # of the grid on which two map files are compared


def by_pairs(pairs: Sequence[str]) -> FoundFrame:
    """From places that are known in both. FrameError: as ``from_point_pairs``."""
    places = [_places(text) for text in pairs]
    return from_point_pairs([b for b, _ in places], [m for _, m in places])


def by_tag(robot: RobotFile, sightings_file: Path, cameras_file: Path) -> FoundFrame:
    """From sightings of its tag. The robot said its stops with the ``T_building_map`` that its file has.

    Raises:
        ConfigError: one of the files has a mistake. FrameError: as ``from_tag``.
    """
    sightings, cameras = load_sightings(sightings_file), load_cameras(cameras_file)
    for stop in sightings.stops:
        if stop.floor not in cameras.floors:
            known = ", ".join(cameras.floors) or "none"
            raise ConfigError(
                f"{sightings_file}, line {stop.line}: this stop is on floor {stop.floor!r}, but the floors of {cameras_file} are "
                f"{known}"
            )
    T_building_reported = robot.T_building_map.transform() if robot.T_building_map else PlanarTransform()
    T_reported_building = T_building_reported.inverse()
    for stop in sightings.stops:
        x, y = T_reported_building.apply((stop.x_m, stop.y_m))
        stop.x_m, stop.y_m, stop.yaw_rad = float(x), float(y), stop.yaw_rad + T_reported_building.yaw_rad
    return from_tag(
        sightings,
        {name: entry.lens.lens() for name, entry in cameras.cameras.items()},
        {name: entry.pose() for name, entry in cameras.cameras.items()},
        {name: floor.z_m for name, floor in cameras.floors.items()},
    )


def by_map(robot: RobotFile, map_file: Path, building: Path | None, url: str) -> FoundFrame:
    """From its map of its floor, matched with the joint map that a system has, or with the map of a building file.

    Raises:
        ConfigError: a file has a mistake. FrameError: as ``match_maps``. GatewayError: there is no such floor, or no system.
    """
    own = load_nav2_map(map_file)
    if building is not None:
        return match_maps(own, *_layers_of_file(building, robot.floor))
    with gateway(url) as asked:
        place = asked.layer(robot.floor, "occupancy")
        occupancy, explored = (asked.layer_array(robot.floor, name) for name in ("occupancy", "explored"))
        after = asked.layer(robot.floor, "explored")
    if place.T_world_cell != after.T_world_cell or not occupancy.shape == explored.shape == (after.rows, after.cols):
        raise ConfigError("the joint map grew while it was read: try again")
    x0, y0 = (float(place.T_world_cell[row][2]) - place.resolution_m / 2 for row in (0, 1))
    return match_maps(own, Grid(x0, y0, place.resolution_m, *occupancy.shape), occupancy, explored)


def _layers_of_file(path: Path, floor: str) -> tuple[Grid, NDArray[np.uint8], NDArray[np.uint8]]:
    """Obstacles and what is known, by the map that a building file names of a floor."""
    entry = load_building(path).floors.get(floor)
    if entry is None or entry.nav2_map is None or entry.T_building_map is None:
        raise ConfigError(f"{path} names no nav2_map of floor {floor!r}, which is the robot's by its file")
    known, T = load_nav2_map(entry.nav2_map), entry.T_building_map.transform()
    x0, y0, x1, y1 = known.extent(T)
    grid = Grid(x0, y0, _CELL_M, int((y1 - y0) / _CELL_M) + 1, int((x1 - x0) / _CELL_M) + 1)
    kinds = known.on_grid(grid, T)
    return grid, (kinds == OCCUPIED).astype(np.uint8), (kinds != UNKNOWN).astype(np.uint8)


def _places(text: str) -> tuple[Sequence[float], Sequence[float]]:
    """The two places of ``x,y=x,y``."""
    try:
        building, map_ = ([float(v) for v in side.split(",")] for side in text.split("="))
        if len(building) != 2 or len(map_) != 2:
            raise ValueError
    except ValueError:
        raise typer.BadParameter(
            f"expected a place in the building and one in the map, such as 3.2,1.0=0.4,-2.1, got {text!r}"
        ) from None
    return building, map_
