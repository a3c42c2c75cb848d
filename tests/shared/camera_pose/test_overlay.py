from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.camera_pose import FloorPlan
from surveilnav.camera_pose.overlay import draw_overlay
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.geometry.lens import BrownConrady, KannalaBrandt, Lens
from tests.clicked_points import LENS, T_WORLD_CAMERA

BARREL = BrownConrady(LENS.pinhole, (-0.25, 0.08, 0.0, 0.0))
BLACK = np.zeros((960, 1280, 3), np.uint8)


def pixel_of(lens: Lens, p_world: tuple[float, float, float]) -> tuple[int, int]:
    u, v = lens.pixels((np.array(p_world) - T_WORLD_CAMERA[:3, 3]) @ T_WORLD_CAMERA[:3, :3])
    return round(float(u)), round(float(v))


@pytest.mark.parametrize("lens", [LENS, BARREL], ids=["pinhole", "barrel"])
def test_a_line_of_the_grid_lies_where_it_is_seen(lens: Lens) -> None:
    drawn = draw_overlay(BLACK, lens, T_WORLD_CAMERA, 0.0)
    for on in ((3.0, 0.5, 0.0), (4.0, -0.3, 0.0), (3.5, 1.0, 0.0), (6.5, -2.0, 0.0)):
        u, v = pixel_of(lens, on)
        assert drawn[v - 1 : v + 2, u - 1 : u + 2].any(), on
    for off in ((3.5, 0.5, 0.0), (4.5, -0.5, 0.0), (2.5, 0.5, 0.0)):
        u, v = pixel_of(lens, off)
        assert not drawn[v - 5 : v + 6, u - 5 : u + 6].any(), off
    assert not drawn[:150].any()  # above the horizon, where what lies behind the camera would show


def test_walls_are_drawn_by_their_outlines() -> None:
    walls = np.zeros((200, 200), bool)
    walls[60:140, 80:88] = True  # x from 4.0 to 4.4 m, y from -2 to 2 m
    plan = FloorPlan(200, 200, 0.05, (0.0, -5.0), walls=walls)
    alone = draw_overlay(BLACK, LENS, T_WORLD_CAMERA, 0.0)
    drawn = draw_overlay(BLACK, LENS, T_WORLD_CAMERA, 0.0, plan)
    new = (drawn != alone).any(axis=2)
    for x in (4.025, 4.375):
        u, v = pixel_of(LENS, (x, 0.5, 0.0))
        assert new[v - 2 : v + 3, u].any(), x
    u, v = pixel_of(LENS, (4.2, 0.5, 0.0))
    assert not new[v - 3 : v + 4, u].any()
    assert not draw_overlay(BLACK, LENS, T_WORLD_CAMERA, 2.0, plan)[v, u].any()  # another floor lies elsewhere


def test_an_arrow_leads_from_where_a_point_should_be_to_the_click() -> None:
    p_world = np.array([[3.5, 0.5, 0.0], [4.5, -1.5, 0.0]])
    should = np.array([pixel_of(LENS, tuple(p)) for p in p_world], float)
    clicked = should + np.array([[0, 0], [60, 0]])
    alone = draw_overlay(BLACK, LENS, T_WORLD_CAMERA, 0.0)
    drawn = draw_overlay(BLACK, LENS, T_WORLD_CAMERA, 0.0, None, clicked, p_world, np.array([True, False]))
    new = (drawn != alone).any(axis=2)
    u, v = (int(x) for x in should[1])
    assert new[v - 1 : v + 2, u + 2 : u + 50].any(axis=0).all()
    b, g, r = (int(x) for x in drawn[v, u + 25])
    assert r > 150 > max(b, g)  # it contradicts the others: red
    u, v = (int(x) for x in should[0])
    assert not new[v - 1 : v + 2, u + 12 : u + 50].any(axis=0).all()


def test_a_fisheye_on_the_ceiling_sees_the_grid_all_around() -> None:
    lens = KannalaBrandt(Pinhole(1280, 960, 300.0, 300.0, 639.5, 479.5))
    drawn = draw_overlay(BLACK, lens, camera_pose((0.5, 0.5, 2.5), 0.0, -math.pi / 2), 0.0)
    assert all(quarter.any() for half in np.split(drawn, 2) for quarter in np.split(half, 2, axis=1))


def test_a_picture_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="expected 1280 x 960 pixels, got 640 x 480"):
        draw_overlay(np.zeros((480, 640, 3), np.uint8), LENS, T_WORLD_CAMERA, 0.0)
