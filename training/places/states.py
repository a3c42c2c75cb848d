"""States of the joint maps, recorded while searches are played, and how far every goal category truly was from everywhere.

There is a file for each search (``StateWriter``) and one for each building (``TrueWays``), so that features can be changed
without playing anew.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import TargetError
from surveilnav.geometry import Grid
from surveilnav.messages import ObjectRecord
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.planner.core import Decision, FloorMaps, RobotView
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.world.goals import find_goals
from surveilnav.simulator.world.labels import TARGETS

#: A state is kept every so many steps: the maps change little in between.
EVERY_STEPS = 6
#: The value map is kept coarser, by its maximum: values change over metres.
_VALUE_CELLS = 4
_LAYERS = ("occupancy", "explored", "frontier")


@dataclass(frozen=True, eq=False)
class State:
    """The maps of the robot's floor at one step of a search for ``searched``, and where the robot was."""

    step: int
    searched: str
    maps: FloorMaps
    robot: RobotView


class StateWriter:
    """Looks on while a search is played (``on_step``) and writes what it saw of it."""

    def __init__(self, searched: str) -> None:
        self._searched = searched
        self._arrays: dict[str, Any] = {}
        self._states: list[dict[str, Any]] = []
        self._step = 0

    def on_step(self, seq: int, view: PosedView, joint: JointMap, maps: FloorMaps, decision: Decision) -> None:
        """See ``episode.OnStep``."""
        self._step += 1
        if (self._step - 1) % EVERY_STEPS:
            return
        n = len(self._states)
        for name in _LAYERS:
            self._arrays[f"{name}_{n}"] = getattr(maps, name)
        self._arrays[f"value_{n}"] = _coarse(maps.value)
        T = view.T_world_camera
        grid = maps.grid
        self._states.append(
            {
                "step": self._step,
                "floor": maps.floor,
                "floor_z_m": maps.floor_z_m,
                "grid": [grid.origin_x_m, grid.origin_y_m, grid.resolution_m, grid.rows, grid.cols],
                "robot": [float(T[0, 3]), float(T[1, 3]), float(np.arctan2(T[1, 2], T[0, 2]))],
                "objects": [msgspec.to_builtins(_slim(o)) for o in maps.objects],
            }
        )

    def write(self, path: Path) -> None:
        """Writes all at once: where the file is, it is whole."""
        path.parent.mkdir(parents=True, exist_ok=True)
        about = json.dumps({"searched": self._searched, "states": self._states}).encode()
        part = path.with_suffix(".part")
        with part.open("wb") as file:
            np.savez_compressed(file, about=np.frombuffer(about, np.uint8), **self._arrays)
        part.rename(path)


def read_states(path: Path) -> Iterator[State]:
    """The states of a search, in order."""
    with np.load(path) as file:
        about = json.loads(file["about"].tobytes())
        for n, s in enumerate(about["states"]):
            grid = Grid(*s["grid"])
            layers = {name: file[f"{name}_{n}"] for name in _LAYERS}
            objects = [msgspec.convert(o, ObjectRecord) for o in s["objects"]]
            maps = FloorMaps(
                s["floor"],
                s["floor_z_m"],
                grid,
                layers["occupancy"],
                layers["explored"],
                layers["frontier"],
                _fine(file[f"value_{n}" if f"value_{n}" in file else f"{about['searched']}_{n}"], grid.shape),
                objects,
                revision=n + 1,
            )
            x, y, yaw = s["robot"]
            robot = RobotView(n, x, y, yaw, 0.0, s["floor"], False, None, 0.0)
            yield State(s["step"], about["searched"], maps, robot)


def write_truth(path: Path, building: SimulatedBuilding) -> None:
    """Writes how far the nearest viewpoint of each category is from everywhere [m], by floor.

    Categories that robots can't get to are left out.
    """
    navigation = building.navigation
    arrays: dict[str, Any] = {}
    for label in TARGETS:
        try:
            field = find_goals(building.scene, navigation, label, caster=building.caster).field
        except TargetError:
            continue
        for floor, distance_m in field.distance_m.items():
            arrays[f"{label}/{floor}"] = distance_m.astype(np.float16)
    grids = {
        name: [g.origin_x_m, g.origin_y_m, g.resolution_m, g.rows, g.cols]
        for name, g in ((n, f.grid) for n, f in navigation.floors.items())
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("wb") as file:
        np.savez_compressed(file, grids=np.frombuffer(json.dumps(grids).encode(), np.uint8), **arrays)


class TrueWays:
    """The distances that ``write_truth`` wrote."""

    def __init__(self, path: Path) -> None:
        with np.load(path) as file:
            self._grids = {name: Grid(*g) for name, g in json.loads(file["grids"].tobytes()).items()}
            self._distance_m = {name: file[name].astype(np.float32) for name in file.files if name != "grids"}

    def categories(self) -> set[str]:
        """Those that robots can get to somewhere in the building."""
        return {name.partition("/")[0] for name in self._distance_m}

    def left_m(self, label: str, floor: str, x_m: float, y_m: float, within_m: float = 1.0) -> float:
        """The way [m] to the nearest viewpoint of a category; inf: there is none.

        If the place isn't free, it is the way from the best free one within ``within_m``.
        """
        grid, distance_m = self._grids[floor], self._distance_m[f"{label}/{floor}"]
        row, col = (int(v) for v in grid.cells_of((x_m, y_m)))
        inside = 0 <= row < grid.rows and 0 <= col < grid.cols
        if inside and np.isfinite(distance_m[row, col]):
            return float(distance_m[row, col])
        k = round(within_m / grid.resolution_m)
        near = distance_m[max(0, row - k) : max(0, row + k + 1), max(0, col - k) : max(0, col + k + 1)]
        return float(near.min(initial=np.inf)) + within_m / 2


def _slim(record: ObjectRecord) -> ObjectRecord:
    return msgspec.structs.replace(record, points=b"", history=[])


def _coarse(value: NDArray[np.float32]) -> NDArray[np.float16]:
    rows, cols = (-n % _VALUE_CELLS for n in value.shape)
    padded = np.pad(value, ((0, rows), (0, cols)), constant_values=np.nan)
    padded = np.where(np.isnan(padded), -9.0, padded)
    shape = padded.shape[0] // _VALUE_CELLS, _VALUE_CELLS, padded.shape[1] // _VALUE_CELLS, _VALUE_CELLS
    top = padded.reshape(shape).max(axis=(1, 3))
    return np.where(top > -9.0, top, np.nan).astype(np.float16)


def _fine(coarse: NDArray[np.float16], shape: tuple[int, int]) -> NDArray[np.float32]:
    size = coarse.shape[1] * _VALUE_CELLS, coarse.shape[0] * _VALUE_CELLS
    fine = cv2.resize(coarse.astype(np.float32), size, interpolation=cv2.INTER_NEAREST)
    return np.ascontiguousarray(fine[: shape[0], : shape[1]])
