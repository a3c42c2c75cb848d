"""What a planning step costs; for CPU time add ``--benchmark-timer=time.process_time``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.planner.core import MapView, MissionState, PlannerConfig, RobotView, step
from surveilnav.geometry import Grid
from surveilnav.messages import ObjectRecord


def flat(side_cells: int) -> MapView:
    """A home of rooms of 4 m with doors of 0.8 m, a third of it unexplored."""
    grid = Grid(0.0, 0.0, 0.05, side_cells, side_cells)
    occupancy = np.zeros(grid.shape, np.uint8)
    for at in range(0, side_cells, 80):
        occupancy[at : at + 2] = occupancy[:, at : at + 2] = 1
    for at in range(0, side_cells, 80):
        for door in range(40, side_cells, 80):
            if at:
                occupancy[at : at + 2, door - 8 : door + 8] = occupancy[door - 8 : door + 8, at : at + 2] = 0
    explored = np.ones(grid.shape, np.uint8)
    explored[:, -side_cells // 3 :] = 0
    frontier = np.zeros(grid.shape, np.uint8)
    frontier[:, -side_cells // 3 - 1] = 1 - occupancy[:, -side_cells // 3 - 1]
    value = np.random.default_rng(0).random(grid.shape).astype(np.float32)
    return MapView("0", 0.0, grid, occupancy, explored, frontier, value, [], 1)


@pytest.mark.parametrize("side_cells", [200, 400])
@pytest.mark.parametrize("goal", ["frontier", "object"])
def test_step(benchmark, side_cells, goal):
    maps = flat(side_cells)
    if goal == "object":
        at = (side_cells * 0.05 - 3.0, side_cells * 0.05 - 2.0, 0.5)
        record = ObjectRecord(
            id=1, floor="0", label="bed", status="confirmed", confidence=0.9, confidence_robot=0.0,
            confidence_surveillance=0.9, label_robot="", label_surveillance="bed", n_detections=4, n_points=400,
            center_m=at, size_m=(1.4, 2.0, 0.6), first_seen_ns=0, last_seen_ns=0, sources=[], reason="",
        )  # fmt: skip
        maps = replace(maps, objects=[record])
    robot = RobotView(0, 2.0, 2.0, 0.3, 0.0, "0", False, None, 0.0)
    state = MissionState("bed", scan_left=0)
    _, decision = benchmark(step, state, maps, robot, PlannerConfig())
    assert decision.action is not None
    assert decision.phase == ("exploring" if goal == "frontier" else "approaching")
