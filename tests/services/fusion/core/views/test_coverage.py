"""How much of a room cameras see, against hand-made floors."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.geometry import Grid, Pinhole, camera_pose
from surveilnav.services.fusion.core.views.coverage import is_outline, room_points_m, room_shares
from surveilnav.services.fusion.core.views.order import KnownFloor, ViewFootprint

LENS = Pinhole.from_hfov(640, 640, math.radians(100.0))
ROOM = [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0), (0.0, 3.0)]


def view(x_m: float, y_m: float, yaw_deg: float) -> ViewFootprint:
    pose = camera_pose((x_m, y_m, 2.5), math.radians(yaw_deg), math.radians(-35.0))
    return ViewFootprint.from_view(pose, LENS, 0.0, 10.0)


def floor(obstacle_x_m: float | None = None, explored: bool = True) -> KnownFloor:
    """10 x 10 m around the room, with a wall along y at ``obstacle_x_m``."""
    grid = Grid(-3.0, -3.0, 0.1, 100, 100)
    occupied = np.zeros(grid.shape, np.uint8)
    if obstacle_x_m is not None:
        occupied[:, int((obstacle_x_m + 3.0) / 0.1)] = 1
    return KnownFloor(grid, occupied, np.full(grid.shape, explored, np.uint8), np.zeros(grid.shape, np.uint8))


@pytest.mark.parametrize(
    "corners_m", [[], [(0.0, 0.0), (1.0, 0.0)], [(0, 0), (1, 0), (math.nan, 1)], [(0, 0), (1, 0), (1e300, 1)]]
)
def test_what_is_no_outline(corners_m: list[tuple[float, float]]) -> None:
    assert not is_outline(corners_m)
    assert is_outline(ROOM)


def test_points_fill_the_outline_evenly() -> None:
    triangle = [(1.0, 1.0), (5.0, 1.0), (1.0, 4.0)]
    points = room_points_m(triangle)
    assert len(points) * 0.01 == pytest.approx(6.0, rel=0.08)
    assert points.min(axis=0) == pytest.approx([1.0, 1.0], abs=0.11)
    assert ((points[:, 0] - 1) / 4 + (points[:, 1] - 1) / 3).max() < 1.05
    assert len(room_points_m([(0, 0), (300, 0), (300, 200), (0, 200)])) < 21_000


def test_a_camera_in_the_corner_sees_most_of_a_free_room() -> None:
    share, by = room_shares(ROOM, {"lobby": [view(0.1, 0.1, 45.0)]}, floor())
    assert share > 0.8
    assert by == {"lobby": share}


def test_what_stands_in_the_way_hides_the_rest_and_counts_neither_way() -> None:
    """The camera stands at x = 0.1, the wall at x = 2: about half of the room is behind it."""
    free, _ = room_shares(ROOM, {"lobby": [view(0.1, 1.5, 0.0)]}, floor())
    walled, _ = room_shares(ROOM, {"lobby": [view(0.1, 1.5, 0.0)]}, floor(obstacle_x_m=2.0))
    behind = [(2.2, 0.0), (4.0, 0.0), (4.0, 3.0), (2.2, 3.0)]
    assert room_shares(behind, {"lobby": [view(0.1, 1.5, 0.0)]}, floor(obstacle_x_m=2.0)) == (0.0, {})
    assert 0.25 < walled < 0.6 * free


def test_floor_that_nobody_explored_isnt_seen() -> None:
    known = floor()
    known.explored[:, 50:] = 0  # x >= 2 m
    share, _ = room_shares(ROOM, {"lobby": [view(0.1, 1.5, 0.0)]}, known)
    assert 0.2 < share < 0.52


def test_while_nothing_is_explored_the_footprint_counts() -> None:
    expected, _ = room_shares(ROOM, {"lobby": [view(0.1, 1.5, 0.0)]}, None)
    assert expected > 0.5
    share, _ = room_shares(ROOM, {"lobby": [view(0.1, 1.5, 0.0)]}, floor(explored=False))
    assert share == pytest.approx(expected)


def test_several_cameras_together() -> None:
    left, right = view(0.1, 1.5, 0.0), view(3.9, 1.5, 180.0)
    share, by = room_shares(ROOM, {"a": [left], "b": [right], "blind": [view(0.1, 1.5, 180.0)], "none": []}, floor())
    assert set(by) == {"a", "b"}
    assert max(by.values()) <= share <= sum(by.values())
    assert room_shares(ROOM, {}, floor()) == (0.0, {})


def test_a_room_full_of_furniture_has_no_share() -> None:
    known = floor()
    known.occupied[:] = 1
    assert room_shares(ROOM, {"a": [view(0.1, 1.5, 0.0)]}, known) == (0.0, {})


def test_a_strip_through_a_door_is_not_a_look_into_the_room() -> None:
    known = floor()
    known.explored[:] = 0
    known.explored[30:60, 45] = 1  # one column of cells: 2.5 % of the room, of which the camera sees a part
    assert room_shares(ROOM, {"a": [view(0.1, 1.5, 0.0)]}, known)[0] > 0.0
    known.explored[42:, 45] = 0
    assert room_shares(ROOM, {"a": [view(0.1, 1.5, 0.0)]}, known) == (0.0, {})
