"""The object map on views of an analytic room."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.sensing.views import DetectedObject
from surveilnav.services.fusion.core import FusionConfig, JointMap, ObjectConfig
from surveilnav.services.fusion.core.objects.config import AssociationConfig, FalsePositiveConfig
from surveilnav.services.fusion.core.objects.sizes import size_mismatch
from surveilnav.services.fusion.core.objects.view_evidence import MAX_CLASSES

SOFA = ((3.0, 1.2, 0.0), (3.8, 2.8, 0.8))
STOOL = ((2.0, 0.4, 0.0), (2.4, 0.8, 0.5))


def associating(**settings):
    return JointMap(FusionConfig(objects=ObjectConfig(association=AssociationConfig(**settings))))


def with_sizes(**settings):
    return JointMap(FusionConfig(objects=ObjectConfig(false_positives=FalsePositiveConfig(**settings))))


@pytest.fixture
def furnished(world):
    world.boxes |= {"sofa": SOFA, "stool": STOOL}
    return world


def around(world, box, n=6, radius=1.8, **more):
    """Views of a robot on a circle that look at a box."""
    cx, cy = ((box[0][k] + box[1][k]) / 2 for k in (0, 1))
    out = []
    for i in range(n):
        a = math.pi - 0.5 + i * 1.0 / n
        out.append(world.view(cx + radius * math.cos(a), cy + radius * math.sin(a), a + math.pi, -0.3, seq=i, **more))
    return out


def test_a_mask_becomes_an_object_where_the_thing_is(furnished, tools):
    joint = JointMap()
    for view in around(furnished, SOFA):
        joint.integrate(view, tools.seen(furnished.detect(view, "sofa", "couch", 0.8, tools.unit(0))))
    (sofa,) = joint.objects("0")
    assert (sofa.label, sofa.status, sofa.n_detections) == ("couch", "confirmed", 6)
    low, high = (np.array(sofa.center_m) + k * np.array(sofa.size_m) / 2 for k in (-1, 1))
    assert np.all(low > np.array(SOFA[0]) - 0.05)
    assert np.all(high < np.array(SOFA[1]) + 0.05)
    assert sofa.size_m[1] > 1.3
    assert sofa.sources == ["robot/r"]
    points = np.frombuffer(sofa.points, np.float32).reshape(-1, 3)
    assert 20 < len(points) <= 256
    assert np.all((points > low - 1e-3) & (points < high + 1e-3))
    assert sofa.history[0].box_px is not None
    assert [e.what for e in sofa.history] == [
        "created",
        "matched",
        "matched",
        "confirmed",
        "matched",
        "matched",
        "matched",
    ]


@pytest.mark.parametrize(("gallery_m", "n_objects"), [(1.2, 1), (1.4, 0)])
def test_what_is_seen_from_a_gallery_is_not_on_its_floor(furnished, tools, gallery_m, n_objects):
    """The sofa stands at 0 m and is 0.8 m high: of a gallery at 1.4 m all of it lies more than 0.5 m below."""
    joint = JointMap()
    for view in around(furnished, SOFA, height=1.8):
        seen = tools.seen(furnished.detect(view, "sofa", "couch", 0.8, tools.unit(0)))
        joint.integrate(replace(view, floor="gallery", mounting_offset_m=1.8 - gallery_m), seen)
    assert len(joint.objects("gallery")) == n_objects


def test_what_lies_flat_on_a_part_of_the_floor_that_is_a_bit_lower_is_still_on_it(furnished, tools):
    """The map's floor is at 0.39 m, where its first view was taken: within tau_z_m of the sofa's, so that both are one floor."""
    furnished.boxes["rug"] = ((2.6, 1.6, 0.0), (3.0, 2.4, 0.03))
    joint = JointMap()
    first, *others = around(furnished, SOFA)
    joint.integrate(replace(first, mounting_offset_m=first.mounting_offset_m - 0.39), None)
    for view in others:
        joint.integrate(view, tools.seen(furnished.detect(view, "rug", "rug", 0.8, tools.unit(0))))
    assert list(joint.floors) == ["0"]
    assert joint.objects("0")


def test_an_object_knows_from_where_it_was_seen(furnished, tools):
    one_side, all_sides = JointMap(), associating(merge_every=1)
    for view in around(furnished, SOFA):
        one_side.integrate(view, tools.seen(furnished.detect(view, "sofa", "couch", 0.8, tools.unit(0))))
    for k in range(12):
        a = 2 * math.pi * k / 12
        view = furnished.view(2.2 + 0.75 * math.cos(a), 0.6 + 0.75 * math.sin(a), a + math.pi, -0.6, seq=k)
        all_sides.integrate(view, tools.seen(furnished.detect(view, "stool", "chair", 0.8, tools.unit(1))))
    (sofa,), (stool,) = one_side.objects("0"), all_sides.objects("0")
    x, y = sofa.seen_from
    assert x < -0.85  # the circle's middle is west of it
    assert abs(y) < 0.3
    assert math.hypot(*stool.seen_from) < 0.25


@pytest.mark.parametrize(("label", "fits"), [("bed", False), ("chair", True), ("unheard of", True)])
def test_only_what_has_the_size_of_its_class_is_confirmed(furnished, tools, label, fits):
    for size_prior in (True, False):
        joint = with_sizes(size_prior=size_prior)
        for view in around(furnished, STOOL, radius=1.3):
            joint.integrate(view, tools.seen(furnished.detect(view, "stool", label, 0.9, tools.unit(0))))
        (stool,) = joint.objects("0")
        assert stool.status == ("confirmed" if fits or not size_prior else "candidate")
        if stool.status == "candidate":
            assert stool.reason.startswith("too small for a bed: 0.")


@pytest.mark.parametrize(
    ("label", "size_m", "top_m", "why"),
    [
        ("bed", (1.9, 1.5, 0.6), 0.6, ""),
        ("bed", (0.6, 0.5, 0.6), 0.6, "too small"),
        ("bed", (5.0, 1.0, 0.6), 0.6, "too large"),
        ("bed", (1.9, 1.5, 0.05), 0.05, "too flat"),  # a rug
        ("bed", (1.9, 0.05, 1.5), 1.5, "too thin"),  # a wall
        ("bed", (1.9, 1.5, 2.5), 2.5, "too high"),  # a wall with a bed before it
        ("tv", (1.0, 0.1, 0.6), 1.8, ""),
        ("tv", (1.0, 0.04, 0.6), 1.8, "too thin"),  # a picture
        ("tv", (1.6, 1.0, 0.9), 1.8, "too bulky"),  # a cupboard
        ("tv", (1.0, 0.6, 0.05), 0.5, "too flat"),
        ("chair", (0.5, 0.5, 0.9), 0.9, ""),
        ("chair", (0.5, 0.5, 0.5), 1.6, "too high"),  # a picture
        ("a dragon", (0.0, 0.0, 0.0), 9.0, ""),
    ],
)
def test_size_mismatches(label, size_m, top_m, why):
    assert size_mismatch(label, size_m, top_m).startswith(why)
    assert bool(size_mismatch(label, size_m, top_m)) == bool(why)


def test_what_has_not_the_size_of_a_class_is_believed_less_to_be_it(furnished, tools):
    """A stool taken for a bed by half the views: as a bed it counts half, as a chair in full."""
    scores = {}
    for factor in (1.0, 0.5):
        joint = with_sizes(size_mismatch_factor=factor)
        for i, view in enumerate(around(furnished, STOOL, radius=1.3)):
            label = "bed" if i % 2 else "chair"
            joint.integrate(view, tools.seen(furnished.detect(view, "stool", label, 0.9, tools.unit(0))))
        (stool,) = joint.objects("0")
        scores[factor] = stool.label_scores
    assert scores[0.5]["chair"] == scores[1.0]["chair"]
    assert scores[0.5]["bed"] == pytest.approx(0.5 * scores[1.0]["bed"])


def test_cameras_and_robot_see_one_object(furnished, tools):
    joint = JointMap()  # one camera sees its back, and hardly a point that the others do: merging finds out
    for i, (x, y, yaw) in enumerate([(0.3, 0.3, 0.6), (0.3, 3.7, -0.6), (5.8, 3.8, -2.4)]):
        view = furnished.view(x, y, yaw, -0.4, height=1.8, source=f"camera/c{i}", view=3)
        joint.integrate(view, tools.seen(furnished.detect(view, "sofa", "couch", 0.6, tools.unit(0))))
    assert len(joint.objects("0")) == 2
    for view in around(furnished, SOFA, 7):
        joint.integrate(view, tools.seen(furnished.detect(view, "sofa", "couch", 0.9, tools.unit(0))))
    (sofa,) = joint.objects("0")
    assert sofa.confidence > sofa.confidence_robot > 0.9, "all that was seen adds up"
    assert 0.6 < sofa.confidence_surveillance < 0.8
    assert len(sofa.sources) == 4


def test_neighbours_of_one_class_stay_two(furnished, tools):
    furnished.boxes["other"] = ((2.0, 1.1, 0.0), (2.4, 1.5, 0.5))  # 30 cm beside the stool, looking just like it
    joint = JointMap()
    for x in (0.4, 0.5, 0.6, 0.7):
        view = furnished.view(x, 0.9, 0.0, -0.3)
        found = [furnished.detect(view, name, "chair", 0.8, tools.unit(1)) for name in ("stool", "other")]
        joint.integrate(view, tools.seen(*found))
    assert sorted(round(o.center_m[1], 1) for o in joint.objects("0")) == [0.6, 1.3]


def test_one_thing_twice_in_a_picture_counts_once(furnished, tools):
    joint = JointMap()
    view = around(furnished, SOFA)[0]
    once = furnished.detect(view, "sofa", "couch", 0.8, tools.unit(0))
    again = DetectedObject("couch", 0.6, once.box_px, once.mask, tools.unit(0))
    joint.integrate(view, tools.seen(again, once))
    (sofa,) = joint.objects("0")
    assert (sofa.n_detections, sofa.confidence) == (1, pytest.approx(0.8))
    literal = associating(once_per_view=False)
    literal.integrate(view, tools.seen(again, once))
    assert [o.n_detections for o in literal.objects("0")] == [2]


def test_another_class_on_the_same_points_is_a_vote_not_an_object(furnished, tools):
    joint = JointMap()
    views = around(furnished, SOFA)
    for i, view in enumerate(views):
        label, look = ("bed", tools.unit(5)) if i == 2 else ("couch", tools.unit(0))
        joint.integrate(view, tools.seen(furnished.detect(view, "sofa", label, 0.8, look)))
    (sofa,) = joint.objects("0")
    assert (sofa.label, sofa.status) == ("couch", "confirmed")
    assert sofa.label_scores["bed"] < 0.05 < 0.85 < sofa.label_scores["couch"]


def test_partial_views_join_by_overlap_and_split_by_box_iou(furnished, tools):
    def halves(geometry, tau):
        joint = associating(geometry=geometry, tau=tau, tau_mutual=None)
        view = around(furnished, SOFA)[3]
        whole = furnished.detect(view, "sofa", "couch", 0.8, tools.unit(0))
        x0, y0, x1, y1 = whole.box_px
        third = x0 + round((x1 - x0) / 4)
        part = DetectedObject("couch", 0.8, (x0, y0, third, y1), whole.mask[:, : int(third - x0)], tools.unit(0))
        joint.integrate(view, tools.seen(whole))
        joint.integrate(view, tools.seen(part))
        return len(joint.objects("0"))

    assert halves("overlap", 1.2) == 1
    assert halves("box_iou", 1.35) == 2


def test_duplicates_are_merged_when_views_have_joined_them(furnished, tools):
    joint = associating(merge_every=2)
    view = around(furnished, SOFA)[3]
    whole = furnished.detect(view, "sofa", "couch", 0.8, tools.unit(0))
    (x0, y0, x1, y1), mask = whole.box_px, whole.mask
    third, rest = round((x1 - x0) / 3), round(2 * (x1 - x0) / 3)
    left = DetectedObject("couch", 0.7, (x0, y0, x0 + third, y1), mask[:, :third], tools.unit(0))
    right = DetectedObject("couch", 0.7, (x0 + rest, y0, x1, y1), mask[:, rest:], tools.unit(0))
    joint.integrate(view, tools.seen(left, right))
    assert len(joint.objects("0")) == 2
    joint.integrate(view, tools.seen(whole))
    (sofa,) = joint.objects("0")
    assert (sofa.n_detections, sofa.id) == (3, 1)
    assert "merged" in [e.what for e in sofa.history]


def test_a_close_look_without_a_detection_counts_against(furnished, tools):
    joint = JointMap()
    for i in range(3):
        view = furnished.view(0.3, 0.3 + 1.7 * i, 0.6 - 0.6 * i, -0.4, height=1.8, source="camera/c", view=i)
        joint.integrate(view, tools.seen(furnished.detect(view, "sofa", "couch", 0.8, tools.unit(0))))
    (before,) = joint.objects("0")
    assert before.status == "confirmed"
    for view in around(furnished, SOFA, 7, radius=2.2):
        joint.integrate(view, tools.seen())
    (after,) = joint.objects("0")
    assert after.status == "candidate"
    assert after.confidence < before.confidence / 1.5
    assert "not_seen" in [e.what for e in after.history]


@pytest.mark.parametrize("how", ["occluded", "far", "behind", "no detector", "camera"])
def test_a_look_that_could_not_show_it_is_no_evidence(furnished, tools, how):
    joint = JointMap()
    for view in around(furnished, STOOL, 3, radius=1.0):
        joint.integrate(view, tools.seen(furnished.detect(view, "stool", "chair", 0.8, tools.unit(0))))
    (before,) = joint.objects("0")
    if how == "occluded":
        furnished.boxes["screen"] = ((1.6, 0.1, 0.0), (1.65, 1.2, 1.2))
    x, yaw = {"far": (5.9, math.pi), "behind": (0.6, math.pi)}.get(how, (0.6, 0.0))
    for i in range(4):
        source = "camera/c" if how == "camera" else "robot/r"
        view = furnished.view(x, 0.6, yaw, -0.3, source=source, view=i if how == "camera" else 0)
        joint.integrate(view, None if how == "no detector" else tools.seen())
    (after,) = joint.objects("0")
    assert after.confidence == before.confidence


def test_history_objects_and_points_are_bounded(furnished, tools):
    config = ObjectConfig(max_history=5, max_objects=2, max_voxels=200)
    joint = JointMap(FusionConfig(objects=config))
    rng = np.random.default_rng(0)
    for i, view in enumerate(around(furnished, SOFA, 30)):
        noise = DetectedObject(
            "cup", 0.3, (*rng.uniform(0, 60, 2), *rng.uniform(70, 110, 2)), None, tools.unit(2 + i % 5)
        )
        joint.integrate(view, tools.seen(furnished.detect(view, "sofa", "couch", 0.8, tools.unit(0)), noise))
    objects = joint.objects("0")
    assert len(objects) <= 2
    assert "couch" in {o.label for o in objects}
    for o in objects:
        assert len(o.history) <= 5
        assert o.n_points <= config.points.max_points


def test_an_object_that_is_called_hundreds_of_things_counts_the_surest_classes(furnished, tools):
    joint = JointMap()
    view = around(furnished, SOFA)[0]
    couch = furnished.detect(view, "sofa", "couch", 0.9, tools.unit(0))
    others = [replace(couch, label=f"thing {i:03}", score=0.3) for i in range(300)]
    joint.integrate(view, tools.seen(*others, couch))
    (found,) = joint.objects("0")
    assert len(found.label_scores) == MAX_CLASSES
    assert {"couch", "thing 000", "thing 062"} < set(found.label_scores)
    assert found.n_detections == 301


def test_the_weakest_objects_are_removed_first(furnished, tools):
    views = around(furnished, SOFA, 1)
    scores = {"cup": 0.5, "vase": 0.4, "bowl": 0.6, "spoon": 0.3}
    found = [
        DetectedObject(label, score, (12.0 + 30 * i, 60.0, 30.0 + 30 * i, 80.0), None, tools.unit(2 + i))
        for i, (label, score) in enumerate(scores.items())
    ]
    joint = JointMap(FusionConfig(objects=ObjectConfig(max_objects=2)))
    joint.integrate(views[0], tools.seen(*found))
    assert {o.label for o in joint.objects("0")} == {"bowl", "cup"}


@pytest.mark.parametrize("score", [0.1, 0.2])
def test_weak_and_empty_detections_are_left_out(furnished, tools, score):
    joint = JointMap()
    view = around(furnished, SOFA)[0]
    off = DetectedObject("couch", 0.9, (500.0, 0.0, 600.0, 50.0), None, tools.unit(0))
    joint.integrate(view, tools.seen(off, furnished.detect(view, "sofa", "couch", score, tools.unit(0))))
    assert joint.objects("0") == []
