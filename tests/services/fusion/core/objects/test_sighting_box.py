"""What a camera without a depth sensor saw counts once the measured object fills the box of its detection."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.geometry import Pinhole, camera_pose, inverse
from surveilnav.sensing.views import DetectedObject, PosedView
from surveilnav.services.fusion.core.objects.sighting_box import SightingBox

LENS = Pinhole.from_hfov(640, 480, math.radians(90.0))
EMBEDDING = np.array([1.0, 0.0], np.float32)


def view(x_m: float = 0.0, y_m: float = 0.0, yaw_deg: float = 0.0) -> PosedView:
    pose = camera_pose((x_m, y_m, 2.5), math.radians(yaw_deg), math.radians(-25.0))
    empty = np.zeros((480, 640, 3), np.uint8), np.zeros((480, 640), np.float32)
    return PosedView("camera/a", 0, 1, 1, "0", pose, LENS, 2.5, *empty, (0.1, 10.0), depth_source="none")


def box_of_points(x_m: float, y_m: float, side_m: float = 0.6, height_m: float = 0.9) -> np.ndarray:
    """Points (N, 3) on a grid in a box that stands on the floor at (x, y)."""
    x, y = (np.linspace(c - side_m / 2, c + side_m / 2, 7) for c in (x_m, y_m))
    return np.stack(np.meshgrid(x, y, np.linspace(0.0, height_m, 7)), axis=-1).reshape(-1, 3)


def seen(v: PosedView, p_world: np.ndarray) -> SightingBox:
    p = np.c_[p_world, np.ones(len(p_world))] @ inverse(v.T_world_camera)[:3].T
    uv = LENS.project(p)
    box = (*uv.min(axis=0).tolist(), *uv.max(axis=0).tolist())
    return SightingBox.from_detection(v, DetectedObject("chair", 0.9, box, None, EMBEDDING))


@pytest.mark.parametrize(("x_m", "y_m"), [(2.0, 0.0), (4.0, 1.5), (6.0, -2.0)])
def test_the_same_thing_is_recognised_also_by_one_side(x_m: float, y_m: float) -> None:
    thing = box_of_points(x_m, y_m)
    sighting = seen(view(), thing)
    assert sighting.shows(thing)
    assert sighting.shows(thing[thing[:, 0] <= x_m]), "the half that faces the camera"


@pytest.mark.parametrize("shift_m", [(1.2, 0.0), (-1.2, 0.0), (0.0, 0.7), (0.0, -0.7)])
def test_a_thing_before_behind_or_beside_it_is_another_one(shift_m: tuple[float, float]) -> None:
    sighting = seen(view(), box_of_points(4.0, 0.0))
    assert not sighting.shows(box_of_points(4.0 + shift_m[0], shift_m[1]))


def test_a_thing_of_another_size_or_behind_the_camera_is_another_one() -> None:
    sighting = seen(view(), box_of_points(4.0, 0.0))
    assert not sighting.shows(box_of_points(4.0, 0.0, side_m=2.2, height_m=1.6))
    assert not sighting.shows(box_of_points(-4.0, 0.0))
    assert not replace(sighting, projection=seen(view(yaw_deg=60.0), box_of_points(4.0, 0.0)).projection).shows(
        box_of_points(4.0, 0.0)
    )


def test_as_plain_values_and_back() -> None:
    sighting = seen(view(), box_of_points(4.0, 0.0))
    again = SightingBox.from_state(sighting.state())
    assert again.shows(box_of_points(4.0, 0.0))
    assert (again.source, again.box_px) == (sighting.source, sighting.box_px)
