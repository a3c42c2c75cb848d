"""Mistakes in a camera's description are found by the floor that it must see, and named."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.fusion.core.config import ValidationConfig
from surveilnav.services.fusion.core.views.plausibility import find_mistake
from surveilnav.services.fusion.core.views.validation import ViewError

LENS = Pinhole.from_hfov(200, 160, math.radians(100))


@pytest.fixture
def views(world):
    world.boxes |= {"table": ((2.5, 1.0, 0.0), (3.3, 1.8, 0.75)), "cupboard": ((4.6, 3.4, 0.0), (5.6, 4.0, 1.8))}
    return [
        world.view(2.0, 2.0, k * math.tau / 6, -0.52, height=1.8, source="camera/c", camera=LENS, view=k)
        for k in range(6)
    ]


def with_focal_length(view, factor):
    c = view.camera
    return replace(view, camera=Pinhole(c.width_px, c.height_px, c.fx_px * factor, c.fy_px * factor, c.cx_px, c.cy_px))


def with_axes_turned(view):
    T = view.T_world_camera.copy()
    T[:3, 1:3] *= -1
    return replace(view, T_world_camera=T)


def rolled(view, deg):
    """The view of a camera that is described as rolled to the right, as seen from behind it."""
    T, a = view.T_world_camera.copy(), math.radians(deg)
    T[:3, :3] = T[:3, :3] @ np.array([[math.cos(a), -math.sin(a), 0], [math.sin(a), math.cos(a), 0], [0, 0, 1]])
    return replace(view, T_world_camera=T)


@pytest.mark.parametrize(
    ("mistake", "named"),
    [
        (lambda view: with_focal_length(view, 0.5), "focal length is 2 times"),
        (lambda view: with_focal_length(view, 2.0), "focal length is 0.5 times"),
        (with_axes_turned, "axes"),
        (lambda view: replace(view, depth_m=view.depth_m * 1000, depth_range_m=(100, 20000)), "millimetres"),
        (lambda view: replace(view, depth_m=view.depth_m / 1000, depth_range_m=(0.0001, 1)), "divided by 1,000"),
    ],
)
def test_a_mistake_is_named_and_leaves_no_trace(views, mistake, named):
    joint = JointMap()
    for view in views:
        with pytest.raises(ViewError, match=named) as refused:
            joint.accept(mistake(view), None)
        assert refused.value.name == "geometry_disagrees"
    assert joint.floors == {}


@pytest.mark.parametrize(
    ("deg", "named"),
    [(180, "upside down"), (-90, "rolled by 90 degrees to the right"), (90, "rolled by 90 degrees to the left")],
)
def test_a_camera_that_hangs_upside_down_or_on_its_side_is_named(views, deg, named):
    joint = JointMap()
    for view in views:
        with pytest.raises(ViewError, match=named):  # a view that shows it too little is refused because of the others
            joint.accept(rolled(view, deg), None)
    assert named in joint.quarantine.reasons()["camera/c"]
    assert joint.floors == {}


def test_a_wrong_camera_is_believed_in_none_of_its_views_until_it_is_described_anew(views, world):
    """A view that shows hardly any floor would pass by itself."""
    up = world.view(2.0, 2.0, 0.0, 0.7, height=1.8, source="camera/c", camera=LENS, view=6)
    joint = JointMap()
    for view in views[:2]:
        with pytest.raises(ViewError, match="focal length"):
            joint.accept(with_focal_length(view, 0.5), None)
    assert list(joint.quarantine.reasons()) == ["camera/c"]
    with pytest.raises(ViewError, match="this camera isn't believed") as refused:
        joint.accept(with_focal_length(up, 0.5), None)
    assert refused.value.name == "quarantined"
    other = replace(up, source="camera/d")
    assert joint.accept(other, None) is not None, "other cameras are believed"
    assert all(joint.accept(view, None) is not None for view in (*views, up))
    assert joint.quarantine.reasons() == {}


def test_one_view_alone_puts_no_camera_into_quarantine(views):
    joint = JointMap()
    assert all(joint.accept(view, None) is not None for view in views[:5])
    with pytest.raises(ViewError, match="focal length"):
        joint.accept(with_focal_length(views[5], 0.5), None)
    assert joint.quarantine.reasons() == {}


def test_right_descriptions_are_believed(views):
    joint = JointMap()
    for view in views:
        assert joint.accept(view, None) is not None


def test_a_view_without_floor_is_believed(world):
    joint = JointMap()
    up = world.view(2.0, 2.0, 0.0, 0.7, height=1.8, source="camera/c", camera=LENS)
    assert joint.accept(up, None) is not None
    world.boxes["table"] = ((0.5, 0.5, 0.0), (5.5, 3.5, 0.75))
    over_a_table = world.view(3.0, 2.0, 0.0, -1.2, height=2.4, source="camera/c", camera=LENS, view=1)
    assert joint.accept(over_a_table, None) is not None


def at_heights(view, heights_m):
    """The view of a camera that looks level, whose rows of points lie at these heights above its floor, 3 m away."""
    T = camera_pose((2.0, 2.0, 2.0), 0.0, 0.0)
    rows = np.linspace(0, len(heights_m) - 1, LENS.height_px).round().astype(int)
    heights_m = np.asarray(heights_m)[rows]
    fy_px = 40.0  # so that 3 m below the camera still is in the picture
    v = fy_px * (2.0 - heights_m) / 3.0 + (LENS.height_px - 1) / 2
    depth_m = np.zeros((LENS.height_px, LENS.width_px), np.float32)
    depth_m[v.round().astype(int).clip(0, LENS.height_px - 1)] = 3.0
    lens = Pinhole(LENS.width_px, LENS.height_px, 100.0, fy_px, (LENS.width_px - 1) / 2, (LENS.height_px - 1) / 2)
    return replace(view, T_world_camera=T, camera=lens, mounting_offset_m=2.0, depth_m=depth_m)


@pytest.mark.parametrize(
    ("heights_m", "why"),
    [
        (np.linspace(0.3, 2.5, 80), ""),
        (np.linspace(-0.3, 2.5, 80), ""),
        (np.linspace(-1.5, 2.5, 80), "lie more than 0.5 m below its floor"),
        ([*np.linspace(-3.02, -2.98, 25), *np.linspace(0.3, 3.5, 75)], ""),  # a lower floor, seen through an opening
        (np.linspace(-5.0, -3.0, 80), "lie more than 0.5 m below its floor"),
        (np.linspace(2.0, 7.0, 80), ""),
        (np.linspace(4.0, 7.0, 80), "lie more than 5.0 m above its floor"),
    ],
    ids=["a wall", "about the floor", "below the floor", "level", "all below", "a high hall", "above any ceiling"],
)
def test_what_a_view_shows_lies_within_its_storey(views, heights_m, why):
    found = find_mistake(at_heights(views[0], heights_m), ValidationConfig())
    assert (why in found) if why else found is None, found


def test_a_robot_is_not_judged_by_its_floor(views):
    joint = JointMap()
    robot = replace(with_focal_length(views[0], 0.5), source="robot/r", view=0)
    assert joint.accept(robot, None) is not None


def test_noise_of_depth_and_a_pose_that_is_off_by_three_degrees_are_believed(views):
    rng, joint = np.random.default_rng(0), JointMap()
    for view in views:
        noisy = view.depth_m * (1 + rng.normal(0, 0.02, view.depth_m.shape)).astype(np.float32)
        T = view.T_world_camera.copy()
        a = math.radians(3)
        T[:3, :3] = T[:3, :3] @ np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
        assert joint.accept(replace(view, depth_m=noisy, T_world_camera=T), None) is not None
