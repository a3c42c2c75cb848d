"""Compiles the inner loops by one step in a made-up map, so that no robot waits for the compiler."""

from __future__ import annotations

import numpy as np

from surveilnav.geometry import Grid
from surveilnav.messages import ObjectRecord
from surveilnav.services.planner.core.config import PlannerConfig
from surveilnav.services.planner.core.inputs import FloorMaps, RobotView
from surveilnav.services.planner.core.memory.mission_state import MissionState
from surveilnav.services.planner.core.step import step

_CHAIR = ObjectRecord(
    id=1,
    floor="0",
    label="chair",
    status="confirmed",
    confidence=0.9,
    confidence_robot=0.9,
    confidence_surveillance=0.0,
    label_robot="chair",
    label_surveillance="",
    n_detections=1,
    n_points=100,
    center_m=(-4.0, 0.0, 0.4),
    size_m=(0.5, 0.5, 0.8),
    first_seen_ns=0,
    last_seen_ns=0,
    sources=["robot/warm-up"],
    reason="",
)


def warm_up(config: PlannerConfig) -> None:
    """Compiles every Numba function that a search calls, or loads it from Numba's cache."""
    maps = _half_a_room()
    robot = RobotView(0, 0.0, 0.0, 0.0, 0.0, maps.floor, False, None, 0.0)
    step(MissionState("chair"), maps, robot, config)


def _half_a_room() -> FloorMaps:
    """A square floor of 12 m between walls, half of it explored, with a chair. The robot stands at (0, 0) [m]."""
    grid = Grid.centred(0.0, 0.0, 12.0, 0.05)
    walls, seen, frontier = (np.zeros(grid.shape, np.uint8) for _ in range(3))
    walls[:2], walls[-2:], walls[:, :2], walls[:, -2:] = 1, 1, 1, 1
    edge = int(grid.cells_of((2.0, 0.0))[1])
    seen[:, :edge], frontier[2:-2, edge - 1] = 1, 1
    value = np.where(seen, 0.2, np.nan).astype(np.float32)
    return FloorMaps("0", 0.0, grid, walls, seen, frontier, value, [_CHAIR], 1)
