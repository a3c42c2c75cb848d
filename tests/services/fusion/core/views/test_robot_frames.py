"""A robot that isn't where it says is named, and not the cameras that contradict it; a wrong camera is still found."""

from __future__ import annotations

import contextlib
import math
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.geometry import Pinhole
from surveilnav.robot_frame import PlanarTransform
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.fusion.core.config import ValidationConfig
from surveilnav.services.fusion.core.snapshot import dump, load
from surveilnav.services.fusion.core.views.quarantine import Quarantine
from surveilnav.services.fusion.core.views.validation import ViewError

LENS = Pinhole.from_hfov(200, 160, math.radians(100))
OFF = PlanarTransform(0.45, -0.25, math.radians(2.0))
PLACES = {"camera/a": (0.4, 0.4), "camera/b": (5.6, 0.4), "camera/c": (3.0, 3.7)}


@pytest.fixture(scope="module")
def room(tools):
    boxes = {
        "table": ((2.5, 1.0, 0.0), (3.3, 1.8, 0.75)),
        "cupboard": ((4.6, 3.4, 0.0), (5.6, 4.0, 1.8)),
        "shelf": ((0.2, 2.8, 0.0), (0.6, 3.8, 1.6)),
    }
    return tools.world(boxes=boxes)


@pytest.fixture(scope="module")
def cameras(room):
    """By camera, its six views all around."""
    return {
        name: [room.view(x, y, k * math.tau / 6, -0.5, height=1.9, source=name, camera=LENS, view=k) for k in range(6)]
        for name, (x, y) in PLACES.items()
    }


@pytest.fixture(scope="module")
def walk(room):
    """A robot's views along the room and back, as they are in truth."""
    there = [(1.0 + 0.16 * k, 2.3 + 0.3 * math.sin(0.4 * k), 0.7 * k) for k in range(24)]
    return [
        room.view(x, y, yaw, -0.4, seq=k + 1)
        for k, (x, y, yaw) in enumerate([*there, *((x, y, -yaw) for x, y, yaw in reversed(there))])
    ]


def elsewhere(view, T_true_said):
    """The view as a robot sends it that believes to be where T_true_said takes to the truth."""
    return replace(view, T_world_camera=T_true_said.inverse().matrix() @ view.T_world_camera)


def accept(joint, views, first_ns=100):
    """For each view, why it was refused; "" if it wasn't."""
    out = []
    for k, view in enumerate(views):
        try:
            joint.accept(replace(view, stamp_ns=first_ns + k), None)
            out.append("")
        except ViewError as error:
            out.append(error.name)
    return out


def mapped(cameras, *names, config=None):
    joint = JointMap()
    joint.quarantine = Quarantine(config or ValidationConfig(min_refuted_voxels=300))
    for name in names:
        accept(joint, cameras[name], 0)
    return joint


def test_two_cameras_name_a_robot_that_is_off_and_its_views_stay_out(cameras, walk):
    joint = mapped(cameras, "camera/a", "camera/b")
    refused = accept(joint, [elsewhere(view, OFF) for view in walk])
    assert joint.quarantine.reasons() == {}, "no camera is accused"
    problem = joint.quarantine.frames.problems()["robot/r"]
    off_m, off_rad = problem.correction.difference(OFF, (3.0, 2.0))
    assert off_m < 0.08
    assert off_rad < math.radians(0.8)
    assert "cameras a and b" in problem.why
    assert "robots remove r --from-maps" in problem.why
    first = refused.index("frame_disagrees")
    assert set(refused[first:]) == {"frame_disagrees"}, "while it is so, none of its views enters the maps"


def test_a_robot_that_is_where_it_says_again_is_believed_again(cameras, walk):
    joint = mapped(cameras, "camera/a", "camera/b")
    accept(joint, [elsewhere(view, OFF) for view in walk])
    again = [replace(view, seq=k + 1) for k, view in enumerate([*walk, *walk])]  # it began anew, in the right frame
    refused = accept(joint, again, 1000)
    assert refused[0] == "frame_disagrees"
    assert refused[-1] == ""
    assert joint.quarantine.frames.problems() == {}
    assert joint.quarantine.reasons() == {}, "what it looked through in its wrong frame accuses no camera later"


def test_a_wrong_camera_is_named_where_another_agrees_with_the_robot(cameras, walk):
    wrong = [elsewhere(view, OFF) for view in cameras["camera/a"]]
    joint = mapped({**cameras, "camera/a": wrong}, "camera/a", "camera/b", "camera/c")
    accept(joint, walk)
    assert list(joint.quarantine.reasons()) == ["camera/a"]
    assert joint.quarantine.frames.problems() == {}


def test_a_healthy_robot_with_the_noise_of_its_localisation_is_not_named(cameras, walk):
    rng = np.random.default_rng(1)
    noisy = [
        elsewhere(view, PlanarTransform(*rng.normal(0, 0.05, 2), rng.normal(0, math.radians(0.7)))) for view in walk
    ]
    joint = mapped(cameras, *PLACES)
    assert set(accept(joint, noisy)) == {""}
    assert joint.quarantine.reasons() == {}
    assert joint.quarantine.frames.problems() == {}


def test_a_jump_in_mid_way_is_named(cameras, walk):
    joint = mapped(cameras, *PLACES)
    jump = PlanarTransform(0.0, 0.5, 0.0)
    again = [replace(view, seq=len(walk) + view.seq) for view in walk]
    accept(joint, [*walk[:16], *(elsewhere(view, jump) for view in [*walk[16:], *again])])
    assert joint.quarantine.reasons() == {}
    problem = joint.quarantine.frames.problems()["robot/r"]
    assert (problem.dx_m, problem.dy_m) == pytest.approx((0.0, 0.5), abs=0.1)


def test_what_is_known_of_a_robot_outlasts_a_restart(cameras, walk):
    joint = mapped(cameras, "camera/a", "camera/b")
    off = [elsewhere(view, OFF) for view in walk]
    accept(joint, off[:30])
    restored = load(dump(joint), joint.config)
    assert dump(restored) == dump(joint)
    restored.quarantine._config = joint.quarantine._config  # the test's own threshold
    for maps in (joint, restored):
        with contextlib.suppress(ViewError):
            accept(maps, off[30:], 200)
    assert restored.quarantine.frames.problems() == joint.quarantine.frames.problems()
    assert dump(restored) == dump(joint)


def test_what_a_camera_said_is_forgotten_when_it_is_described_anew(cameras, walk):
    joint = mapped(cameras, "camera/a", "camera/b")
    frames = joint.quarantine.frames
    accept(joint, [elsewhere(view, OFF) for view in walk[:9]])
    frames._robots["robot/r"].monitor.corrections = {"camera/a": OFF, "camera/b": OFF}
    accept(joint, [replace(elsewhere(cameras["camera/a"][0], OFF), seq=1)], 500)
    assert list(frames._robots["robot/r"].monitor.corrections) == ["camera/b"]


def named(cameras, walk):
    """Maps with a robot that is known to be off."""
    joint = mapped(cameras, *PLACES)
    accept(joint, [elsewhere(view, OFF) for view in walk])
    assert list(joint.quarantine.frames.problems()) == ["robot/r"]
    return joint


def test_a_robot_that_says_that_it_is_far_away_costs_nothing(cameras, walk):
    """The grid on which it is compared is as large as what it has seen, and not as its distance from the cameras."""
    joint = named(cameras, walk)
    far = PlanarTransform(-1e6, 1e6, 0.0)
    views = [replace(elsewhere(view, far), seq=view.seq - 1) for view in walk]
    assert set(accept(joint, views, 1000)) <= {"frame_disagrees", "out_of_map", "pose_jump"}


def test_of_a_robot_that_was_taken_out_of_the_maps_nothing_stays_known(cameras, walk):
    joint = named(cameras, walk)
    joint.quarantine.forget("robot/r")
    assert joint.quarantine.frames.problems() == {}
    assert accept(joint, walk[:2], 2000) == ["", ""]
