"""How large the named buildings are: floors, rooms and their area, read from the plans alone."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from surveilnav.config import cache_dir as default_cache_dir
from surveilnav.simulator.furniture.assets import ensure_assets, is_here
from surveilnav.simulator.furniture.catalog import Furniture
from surveilnav.simulator.plans.outliers import without_outliers
from surveilnav.simulator.plans.shell import Shell
from surveilnav.simulator.sources import EXAMPLE_HOMES, PARAMETRIC, list_buildings, open_building, read_example
from surveilnav.simulator.world.polygons import signed_area
from surveilnav.simulator.world.scene import Floor, Room


@dataclass(frozen=True, slots=True)
class Size:
    """``floors``: their ids, from the lowest up. ``area_m2``: of all rooms as they are drawn."""

    floors: tuple[str, ...]
    rooms: int
    area_m2: float


def sizes(cache_dir: Path | None = None) -> Iterator[tuple[str, Size | None]]:
    """Every name of ``list_buildings`` with its size. None: the number in the name decides it, or the plan isn't on this
    machine; nothing is downloaded for it."""
    cache = cache_dir if cache_dir is not None else default_cache_dir()
    if not is_here(cache):
        for building in list_buildings():
            yield building.name, _of_parametric(building.name)
        return
    with Furniture(ensure_assets(cache=cache), cache) as furniture:
        for building in list_buildings():
            example = building.name in EXAMPLE_HOMES
            yield building.name, _of_example(building.name, furniture) if example else _of_parametric(building.name)


def _of_example(name: str, furniture: Furniture) -> Size:
    home, _ = without_outliers(read_example(name, furniture))
    shell = Shell(home, name, 0, None)
    shell.build_shell()
    return _size(shell.builder.floors, shell.builder.rooms)


def _of_parametric(name: str) -> Size | None:
    if name not in PARAMETRIC:
        return None
    scene = open_building(name)
    return _size(scene.floors, scene.rooms)


def _size(floors: tuple[Floor, ...] | list[Floor], rooms: tuple[Room, ...] | list[Room]) -> Size:
    area_m2 = sum(abs(float(signed_area(np.asarray(room.polygon_m)))) for room in rooms)
    return Size(tuple(floor.id for floor in floors), len(rooms), round(area_m2, 1))
