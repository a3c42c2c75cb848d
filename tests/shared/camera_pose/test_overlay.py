from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.camera_pose import FloorPlan
from surveilnav.camera_pose.footprint import seen_floor
from surveilnav.camera_pose.overlay import draw_overlay, projected, visible_lines
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


@pytest.mark.parametrize("lens", [LENS, BARREL], ids=["pinhole", "barrel"])
def test_visible_lines_are_the_projected_points_in_front(lens: Lens) -> None:
    line = np.column_stack([np.arange(-5.0, 8.0, 0.1), np.full(130, 0.5), np.zeros(130)])
    (seen,) = visible_lines(lens, T_WORLD_CAMERA, [line])
    assert seen[-1] == pytest.approx(projected(lens, T_WORLD_CAMERA, line[-1:])[0])
    assert seen[-1, 1] < seen[0, 1] < 2 * 960  # from below the picture towards the horizon
    assert 20 < len(seen) < 80  # nothing of what lies behind


def test_the_floor_in_view_is_bounded_by_the_pictures_edge() -> None:
    outline = seen_floor(LENS, T_WORLD_CAMERA, 0.0, 10.0)
    nearest, farthest = (np.sort(np.linalg.norm(outline, axis=1))[i] for i in (0, -1))
    assert nearest == pytest.approx(2.5 / math.tan(math.radians(25) + math.atan(480 / 900)), rel=1e-3)
    assert farthest == pytest.approx(10.0)  # the top of the picture shows the horizon
    corner = pixel_of(LENS, (*outline[48], 0.0))  # the third side begins at the lower right
    assert corner == pytest.approx((1279.5, 959.5), abs=1)
    assert outline[48, 1] < 0  # to the right


def test_a_fisheyes_picture_that_leaves_the_corners_dark_still_has_a_floor() -> None:
    lens = KannalaBrandt(Pinhole(1280, 960, 300.0, 300.0, 639.5, 479.5))
    outline = seen_floor(lens, camera_pose((1.0, 2.0, 2.5), 0.0, -math.pi / 2), 0.0, 6.0)
    assert np.linalg.norm(outline - (1.0, 2.0), axis=1) == pytest.approx(np.full(len(outline), 6.0))
