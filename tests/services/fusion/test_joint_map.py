"""Floors, layers and what is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from services.fusion.core import JointMap, canonical
from surveilnav.sensing.views import Detected


def test_a_floor_is_known_by_its_altitude(world):
    joint = JointMap()
    for floor, z in (("0", 0.0), ("1", 2.8), ("0", 0.3), ("mezzanine", 0.35), ("1", 2.6)):
        joint.integrate(world.view(2, 2, 0, floor=floor, floor_z=z), None)
    assert joint.floors == {"0": 0.0, "1": pytest.approx(2.8)}
    assert joint.layer("mezzanine", "explored")[1].sum() == joint.layer("0", "explored")[1].sum() > 0
    assert joint.floor_revision("0") == 4
    assert joint.revision == joint.floor_revision("1") == 5


def test_one_name_for_two_altitudes_makes_two_floors(world):
    joint = JointMap()
    joint.integrate(world.view(2, 2, 0, floor="0"), None)
    joint.integrate(world.view(2, 2, 0, floor="0", floor_z=3.0), None)
    assert joint.floors == {"0": 0.0, "0-2": pytest.approx(3.0)}


def test_what_is_asked_for_must_be_there(world):
    joint = JointMap()
    joint.integrate(world.view(2, 2, 0), None)
    with pytest.raises(KeyError, match=r"there are maps of \['0'\]"):
        joint.layer("7", "explored")
    with pytest.raises(KeyError, match="occupancy"):
        joint.layer("0", "beauty")
    with pytest.raises(ValueError, match="text embedding"):
        joint.layer("0", "value")
    with pytest.raises(KeyError):
        joint.objects("7")


def broken(view, tools):
    bad = np.full(8, np.nan, np.float32)
    T = view.T_world_camera.copy()
    T[0, 3] = np.inf
    return {
        "depth of another size": (replace(view, depth_m=view.depth_m[:-1]), None),
        "colour of another type": (replace(view, rgb=view.rgb.astype(float)), None),
        "a pose from nowhere": (replace(view, T_world_camera=T), None),
        "a box of NaN": (view, tools.seen(Detected("c", 0.5, (np.nan, 0, 5, 5), None, tools.unit(0)))),
        "an embedding of NaN": (view, tools.seen(Detected("c", 0.5, (0, 0, 5, 5), None, bad))),
        "a picture's embedding of NaN": (view, tools.seen(image=bad)),
        "a mask of another size": (
            view,
            tools.seen(Detected("c", 0.5, (0, 0, 5, 5), np.ones((3, 3), np.bool_), tools.unit(0))),
        ),
    }


@pytest.mark.parametrize("what", [
    "depth of another size", "colour of another type", "a pose from nowhere", "a box of NaN", "an embedding of NaN",
    "a picture's embedding of NaN", "a mask of another size",
])  # fmt: skip
def test_a_broken_view_is_refused_and_changes_nothing(world, tools, what):
    joint = JointMap()
    view, perception = broken(world.view(2, 2, 0), tools)[what]
    with pytest.raises(ValueError):
        joint.integrate(view, perception)
    assert joint.revision == 0
    assert all(len(s.geometry.cloud.array()) == 0 for s in joint._storeys.values())


def test_a_view_without_any_depth_is_no_problem(world, tools):
    view = world.view(2, 2, 0)
    joint = JointMap()
    done = joint.integrate(replace(view, depth_m=np.full_like(view.depth_m, np.nan)), tools.seen())
    assert (done.n_points, joint.layer("0", "cloud")[1].shape) == (0, (0, 6))
    assert np.isnan(joint.layer("0", "value", tools.unit(0))[1]).all()


def test_the_canonical_order(world):
    views = [
        replace(world.view(1, 1, 0, source=s, view=v), stamp_ns=t)
        for t, s, v in ((2, "robot/a", 0), (1, "robot/b", 0), (1, "camera/z", 1), (1, "camera/z", 0))
    ]
    assert [(v.stamp_ns, v.source, v.view) for v in canonical(views)] == [
        (1, "camera/z", 0), (1, "camera/z", 1), (1, "robot/b", 0), (2, "robot/a", 0),
    ]  # fmt: skip
