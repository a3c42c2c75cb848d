"""Things in views without depth: where they are put, how certain that is, and who measures better wins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole, camera_pose, inverse, transform_points
from surveilnav.sensing.views import DetectedObject, PosedView, ViewPerception
from surveilnav.services.fusion.core import JointMap, snapshot
from surveilnav.services.fusion.core.objects import object_map
from surveilnav.services.fusion.core.objects.config import FootPointConfig
from surveilnav.services.fusion.core.objects.foot_point import locate_by_foot
from surveilnav.services.fusion.core.removal import Contribution, without

LENS = Pinhole.from_hfov(640, 480, math.radians(90))
CONFIG = FootPointConfig()
EMBEDDING = np.eye(8, dtype=np.float32)[0]


def view(position_m=(0.0, 0.0, 2.5), yaw=0.0, pitch=-0.5, name="c1", seq=1, **more) -> PosedView:  # type: ignore[no-untyped-def]
    T = camera_pose(position_m, yaw, pitch)
    fields = {
        "source": f"camera/{name}",
        "view": 0,
        "seq": seq,
        "stamp_ns": seq,
        "floor": "0",
        "T_world_camera": T,
        "camera": LENS,
        "mounting_offset_m": position_m[2],
        "rgb": np.zeros((480, 640, 3), np.uint8),
        "depth_m": np.zeros((480, 640), np.float32),
        "depth_range_m": (0.1, 100.0),
        "depth_source": "none",
    }
    return PosedView(**(fields | more))


def seen(v: PosedView, box: np.ndarray, label: str = "chair") -> DetectedObject:
    """What a detector finds of a box (2, 3) of corners in the world: the box around its corners' pixels, no mask."""
    corners = np.array([[box[i, 0], box[j, 1], box[k, 2]] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    uv = v.camera.project(transform_points(inverse(v.T_world_camera), corners))
    (x0, y0), (x1, y1) = uv.min(axis=0), uv.max(axis=0)
    return DetectedObject(label, 0.9, (float(x0), float(y0), float(x1), float(y1)), None, EMBEDDING)


def chair(x: float, y: float, side: float = 0.5, height: float = 0.9, base: float = 0.0) -> np.ndarray:
    return np.array([[x - side / 2, y - side / 2, base], [x + side / 2, y + side / 2, base + height]])


@settings(max_examples=60)
@given(x=st.floats(2.5, 7.0), y=st.floats(-1.5, 1.5))
def test_a_thing_on_the_floor_is_put_where_it_stands(x: float, y: float) -> None:
    v = view()
    found = locate_by_foot(v, seen(v, chair(x, y)), 0.0, CONFIG)
    assert found is not None
    centre = (found.p_world.min(axis=0) + found.p_world.max(axis=0)) / 2
    assert math.dist(centre[:2], (x, y)) < 0.3
    assert found.p_world[:, 2].min() == pytest.approx(0.0, abs=0.06)
    sigma_m = math.sqrt(np.linalg.eigvalsh(found.covariance_m2)[-1])
    r = found.range_m
    expected = (2.5**2 + r**2) / 2.5 * math.hypot(3 / LENS.fy_px, 0.009)  # the formula in the module, literally
    assert sigma_m == pytest.approx(math.hypot(expected, r / 2.5 * 0.02), rel=1e-6)


def test_the_covariance_is_that_of_many_noisy_measurements() -> None:
    rng, v, config = np.random.default_rng(0), view(), FootPointConfig(sigma_px=3.0, sigma_pose_rad=0.0)
    exact = seen(v, chair(5.0, 1.0))
    feet = []
    for _ in range(400):
        x0, y0, x1, y1 = exact.box_px
        noisy = replace(exact, box_px=(x0, y0, x1, round(y1) + float(np.round(rng.normal(0.0, 3.0)))))
        found = locate_by_foot(v, noisy, 0.0, config)
        assert found is not None
        feet.append(found.range_m)
    stated = locate_by_foot(v, exact, 0.0, config)
    assert stated is not None
    ahead = np.array([5.0, 1.0]) / math.hypot(5.0, 1.0)
    stated_m = math.sqrt(float(ahead @ stated.covariance_m2 @ ahead))
    assert np.std(feet) == pytest.approx(stated_m, rel=0.2)


def test_a_tv_stands_higher_and_is_less_certain() -> None:
    v = view()
    tv = chair(4.0, 0.0, side=0.8, height=0.6, base=0.75)
    patient = FootPointConfig(max_sigma_m=2.0)
    as_tv, as_chair = (locate_by_foot(v, seen(v, tv, label), 0.0, patient) for label in ("tv", "chair"))
    strict = FootPointConfig(max_sigma_m=0.4)
    assert locate_by_foot(v, seen(v, tv, "tv"), 0.0, strict) is None, "too uncertain"
    assert as_tv is not None
    assert as_chair is not None
    assert abs(as_tv.range_m - 3.6) < 0.3  # its front
    assert as_chair.range_m > 4.8
    assert np.trace(as_tv.covariance_m2) > 4 * np.trace(as_chair.covariance_m2)


@pytest.mark.parametrize(
    "box_px",
    [
        (300.0, 300.0, 360.0, 480.0),  # cut off by the lower edge of the picture
        (300.0, 20.0, 360.0, 60.0),  # its foot is above the horizon
        (300.0, 120.0, 360.0, 130.0),  # its foot is far away
    ],
)
def test_what_has_no_foot_in_view_is_not_located(box_px: tuple[float, float, float, float]) -> None:
    assert locate_by_foot(view(pitch=-0.2), DetectedObject("chair", 0.9, box_px, None, EMBEDDING), 0.0, CONFIG) is None


def test_a_view_without_depth_leaves_geometry_alone_and_gives_objects(tools) -> None:  # type: ignore[no-untyped-def]
    joint = JointMap()
    v = view()
    result = joint.accept(v, tools.seen(seen(v, chair(4.0, 0.0))))
    assert result is not None
    assert (result.n_points, result.n_located) == (0, 1)
    assert not joint.layer("0", "occupancy")[1].any()
    assert not joint.layer("0", "explored")[1].any()
    (record,) = joint.objects("0")
    assert math.dist(record.center_m[:2], (4.0, 0.0)) < 0.3
    assert 0.05 < record.position_sigma_m < 0.3


def test_two_cameras_agree_on_one_thing_and_are_more_certain_together(tools) -> None:  # type: ignore[no-untyped-def]
    joint = JointMap()
    one, other = view(), view((8.0, 0.5, 2.5), yaw=math.pi, name="c2", seq=2)
    for v in (one, other):
        joint.accept(v, tools.seen(seen(v, chair(4.2, 0.2))))
    (record,) = joint.objects("0")
    assert record.n_detections == 2
    alone = JointMap()
    alone.accept(one, tools.seen(seen(one, chair(4.2, 0.2))))
    assert record.position_sigma_m < 0.8 * alone.objects("0")[0].position_sigma_m
    assert math.dist(record.center_m[:2], (4.2, 0.2)) < 0.25


def test_the_same_camera_again_is_no_further_evidence_of_the_place(tools) -> None:  # type: ignore[no-untyped-def]
    joint = JointMap()
    for seq in range(1, 6):
        v = view(seq=seq)
        joint.accept(v, tools.seen(seen(v, chair(4.2, 0.2))))
    alone = JointMap()
    alone.accept(view(), tools.seen(seen(view(), chair(4.2, 0.2))))
    (record,) = joint.objects("0")
    assert record.position_sigma_m == pytest.approx(alone.objects("0")[0].position_sigma_m)


def test_things_of_other_classes_or_far_apart_stay_apart(tools) -> None:  # type: ignore[no-untyped-def]
    joint = JointMap()
    v = view()
    things = (seen(v, chair(3.0, -1.0)), seen(v, chair(3.0, 1.5)), seen(v, chair(5.0, 0.0), "couch"))
    joint.accept(v, tools.seen(*things))
    assert len(joint.objects("0")) == 3


STOOL = ((2.0, 0.4, 0.0), (2.4, 0.8, 0.5))


def measured(world, tools):  # type: ignore[no-untyped-def]
    world.boxes |= {"stool": STOOL}
    robot = world.view(0.8, 0.6, 0.0, -0.3, seq=1)
    return robot, tools.seen(world.detect(robot, "stool", "chair", 0.8, EMBEDDING))


@pytest.mark.parametrize("robot_first", [True, False])
def test_who_measures_better_wins(world, tools, robot_first: bool) -> None:  # type: ignore[no-untyped-def]
    robot, by_robot = measured(world, tools)
    v = view((-2.5, 0.6, 2.0), pitch=-0.4, seq=2)
    estimated = seen(v, np.array(STOOL) + np.array([0.15, 0.0, 0.0]))  # 15 cm too far
    joint = JointMap()
    steps = [(robot, by_robot), (v, tools.seen(estimated))]
    for step in steps if robot_first else steps[::-1]:
        joint.accept(*step)
    only_robot = JointMap()
    only_robot.accept(robot, by_robot)
    (record,), (expected,) = joint.objects("0"), only_robot.objects("0")
    assert record.n_detections == 2
    assert record.position_sigma_m == 0.0
    assert record.center_m == pytest.approx(expected.center_m)
    assert record.size_m == pytest.approx(expected.size_m)


def test_an_uncertain_place_is_not_missed_where_a_robot_looks(world, tools) -> None:  # type: ignore[no-untyped-def]
    world.boxes |= {"stool": STOOL}
    v = view((-5.0, 0.6, 2.5), pitch=-0.3, seq=1)
    joint = JointMap()
    joint.accept(v, tools.seen(seen(v, np.array(STOOL))))
    assert joint.objects("0")[0].position_sigma_m > CONFIG.miss_max_sigma_m
    for seq in range(1, 6):
        joint.accept(world.view(0.8, 0.6, 0.0, -0.3, seq=seq + 1), tools.seen())
    assert "not_seen" not in [e.what for e in joint.objects("0")[0].history]


def test_a_thing_is_confirmed_only_once_a_sensor_has_measured_its_place(world, tools) -> None:  # type: ignore[no-untyped-def]
    robot, by_robot = measured(world, tools)
    joint = JointMap()
    for seq, x in enumerate((-2.5, -2.2, -2.0), start=2):
        v = view((x, 0.6, 2.0), pitch=-0.4, seq=seq, name=f"c{seq}")
        joint.accept(v, tools.seen(replace(seen(v, np.array(STOOL)), score=0.95)))
    (record,) = joint.objects("0")
    assert (record.status, record.confidence > 0.85) == ("candidate", True)
    assert "its place is only known to" in record.reason
    joint.accept(robot, by_robot)
    for seq, (x, y, yaw) in enumerate([(1.2, 1.6, -0.8), (2.2, 2.2, -math.pi / 2)], start=2):
        other_side = world.view(x, y, yaw, -0.4, seq=seq)
        joint.accept(other_side, tools.seen(world.detect(other_side, "stool", "chair", 0.8, EMBEDDING)))
    (record,) = joint.objects("0")
    assert (record.status, record.position_sigma_m) == ("confirmed", 0.0)


@pytest.mark.parametrize(
    ("too_far_m", "counts", "robot_first"), [(0, True, True), (0, True, False), (0.8, False, True)]
)
def test_what_a_camera_saw_confirms_the_thing_that_fills_its_box(  # type: ignore[no-untyped-def]
    world, tools, too_far_m: float, counts: bool, robot_first: bool
) -> None:
    """A thing behind the measured one may be the same by its uncertain place, but it isn't just there in the picture."""
    world.boxes |= {"stool": STOOL}
    robot = []
    for seq, (x, y, yaw) in enumerate([(0.8, 0.6, 0.0), (1.2, 1.6, -0.8)], start=1):
        v = world.view(x, y, yaw, -0.3, seq=seq)
        robot.append((v, tools.seen(world.detect(v, "stool", "chair", 0.35, EMBEDDING))))
    v = view((-4.5, 0.6, 2.5), pitch=-0.3, seq=2)
    sighting = seen(v, np.array(STOOL) + np.array([too_far_m, 0.0, 0.0]))
    camera = [(v, tools.seen(replace(sighting, score=0.97)))]
    joint, only_robot = JointMap(), JointMap()
    for step in robot + camera if robot_first else camera + robot:
        joint.accept(*step)
    for step in robot:
        only_robot.accept(*step)
    (record,), (alone,) = joint.objects("0"), only_robot.objects("0")
    assert alone.status == "candidate", "the robot's word alone isn't enough here"
    assert record.n_detections == 3
    assert (record.status == "confirmed") is counts, record.reason


def test_what_a_camera_saw_is_forgotten_when_it_is_taken_out_of_the_maps(world, tools) -> None:  # type: ignore[no-untyped-def]
    world.boxes |= {"stool": STOOL}
    joint = JointMap()
    for seq, (x, y, yaw) in enumerate([(0.8, 0.6, 0.0), (1.2, 1.6, -0.8)], start=1):
        robot = world.view(x, y, yaw, -0.3, seq=seq)
        joint.accept(robot, tools.seen(world.detect(robot, "stool", "chair", 0.35, EMBEDDING)))
    v = view((-4.5, 0.6, 2.5), pitch=-0.3, seq=2)
    joint.accept(v, tools.seen(seen(v, np.array(STOOL) + np.array([0.8, 0.0, 0.0]))))

    def kept(joint: JointMap) -> list[str]:
        (maps,) = joint.state()["floors"]
        (stool,) = maps["objects"]["objects"]
        return [source for source, *_ in stool["estimated"]]

    assert kept(joint) == ["camera/c1"]
    assert kept(without(joint, Contribution("camera/c1"))) == []


def test_a_snapshot_keeps_the_uncertainty(tools) -> None:  # type: ignore[no-untyped-def]
    joint = JointMap()
    v = view()
    joint.accept(v, tools.seen(seen(v, chair(4.0, 0.0))))
    again = snapshot.load(snapshot.dump(joint), joint.config)
    assert again.objects("0")[0].position_sigma_m == joint.objects("0")[0].position_sigma_m


@pytest.mark.parametrize("labels", [1, 1000], ids=["of one class", "each of its own class"])
def test_hundreds_of_things_in_one_place_cost_in_proportion_to_their_number(
    monkeypatch: pytest.MonkeyPatch, labels: int
) -> None:
    calls = []

    def counted(*args: object) -> float:
        calls.append(args)
        return gate_distance(*args)  # type: ignore[arg-type]

    gate_distance = object_map.gate_distance
    monkeypatch.setattr(object_map, "gate_distance", counted)
    joint, n = JointMap(), 120
    for seq in range(1, 5):  # merging is rarer: it would make them one
        v = view(seq=seq, name=f"c{seq}")
        found = tuple(seen(v, chair(4.0, 0.0), f"thing {i % labels}") for i in range(n))
        joint.integrate(v, ViewPerception("test", found, EMBEDDING, "e1"))
    assert len(joint.objects("0")) == n
    assert len(calls) == 3 * n  # of later views, each thing is compared with the first that its view hasn't shown yet
