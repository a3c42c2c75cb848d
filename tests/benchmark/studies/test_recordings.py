"""Recordings: what a detection shows, the tour, and that a kept recording is the one that was made."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from surveilnav.benchmark.studies import recordings
from surveilnav.benchmark.studies.recordings import (
    Facts,
    Recording,
    SeenView,
    Thing,
    Tour,
    Witness,
    instance_of,
    states_of,
)
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.perception.backend import Backend, Stage
from surveilnav.perception.embedders.class_space import embed_image, embed_object
from surveilnav.sensing.packing import decode_depth, encode_depth
from surveilnav.sensing.views import DetectedObject, PosedView, TrueInstances, ViewPerception
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.truth.backends import Oracle
from surveilnav.simulator.world.navigation import NavigationMap

CHAIR = Thing(7, "chair", "0", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
CAMERA = Pinhole.from_hfov(16, 12, math.radians(79))
LOOK = embed_object(np.eye(80)[56])


def detected(box, mask=None):
    return DetectedObject("chair", 0.5, box, mask, LOOK)


def test_a_detection_shows_what_most_of_its_mask_shows():
    ids = np.zeros((12, 16), np.uint16)
    ids[2:6, 2:6], ids[6:12, 2:6] = 7, 9  # 9 is a wall
    assert instance_of(detected((2.0, 2.0, 6.0, 6.0)), ids, {7: CHAIR}) == (7, 1.0)
    assert instance_of(detected((2.0, 2.0, 6.0, 12.0)), ids, {7: CHAIR}) == (0, pytest.approx(0.6))
    mask = np.zeros((10, 4), np.bool_)
    mask[:5] = True
    assert instance_of(detected((2.0, 2.0, 6.0, 12.0), mask), ids, {7: CHAIR}) == (7, pytest.approx(0.8))
    assert instance_of(detected((2.0, 2.0, 6.0, 12.0), np.zeros_like(mask)), ids, {7: CHAIR}) == (0, 0.0)


def test_the_backend_isnt_told_what_the_witness_sees():
    told = []

    class Blind(Backend):
        name, why, embedding_dim = "blind", "", 81

        def __init__(self):
            self.stages = (Stage("look", self.look),)

        def look(self, batch):
            for task in batch:
                told.append(task.truth)
                task.result = ViewPerception("blind", (detected((0.0, 0.0, 4.0, 4.0)),), embed_image([]))

        def embed_texts(self, texts):
            raise NotImplementedError

    ids = np.full((12, 16), 7, np.uint16)
    rgb, depth_m = np.zeros((12, 16, 3), np.uint8), np.ones((12, 16), np.float32)
    witness = Witness(Blind(), {7: CHAIR})
    witness.perceive(rgb, depth_m, CAMERA, truth=TrueInstances(ids), key=("robot/r", 0, 1))
    assert told == [None]
    assert witness.seen == {("robot/r", 0, 1): ((7, 1.0),)}
    knowing = Witness(Oracle(min_pixels=1), {7: CHAIR})
    assert knowing.perceive(rgb, depth_m, CAMERA, truth=TrueInstances(ids, {7: "chair"})).detections
    with pytest.raises(ValueError, match="true instances"):
        witness.perceive(rgb, depth_m, CAMERA)


def test_a_kept_recording_is_the_one_that_was_made(tmp_path):
    depth_range_m = (0.5, 5.0)
    noisy = np.random.default_rng(0).uniform(0.5, 5.0, (12, 16)).astype(np.float32)
    depth_m = decode_depth(encode_depth(noisy, depth_range_m), 16, 12, depth_range_m)  # as it came over the bus
    rgb = np.zeros((12, 16, 3), np.uint8)
    T = camera_pose((1.0, 2.0, 0.88), 0.5, -0.1)
    mask = np.eye(4, dtype=np.bool_)
    said = ViewPerception(
        "blind", (detected((1.0, 1.0, 5.0, 5.0), mask), detected((0.5, 0.0, 4.0, 4.0))), embed_image([])
    )
    views = [
        SeenView(PosedView("camera/c", 12, 1, 0, "0", T, CAMERA, 1.8, rgb, depth_m, depth_range_m), None, ()),
        SeenView(
            PosedView("robot/r1", 0, 3, 3, "0", T, CAMERA, 0.88, rgb, depth_m, depth_range_m),
            said,
            ((7, 1.0), (0, 0.5)),
        ),
    ]
    made = Recording(Facts("studio", 3, "blind", 2, "hash"), {7: CHAIR}, views)
    path = tmp_path / "a.recording"
    recordings.save(made, path)
    kept = recordings.load(path)
    assert (kept.facts, kept.things) == (made.facts, made.things)
    for a, b in zip(kept.views, made.views, strict=True):
        assert (a.truth, a.view.source, a.view.view, a.view.stamp_ns) == (
            b.truth,
            b.view.source,
            b.view.view,
            b.view.stamp_ns,
        )
        np.testing.assert_array_equal(a.view.depth_m, b.view.depth_m)
        np.testing.assert_allclose(a.view.T_world_camera, T, atol=1e-9)
    assert kept.views[0].perception is None
    first, second = kept.views[1].perception.detections
    assert (first.label, first.score, first.box_px) == ("chair", 0.5, (1.0, 1.0, 5.0, 5.0))
    np.testing.assert_array_equal(first.mask, mask)
    np.testing.assert_allclose(first.embedding, LOOK, atol=1e-3)
    assert second.mask is None
    path.write_bytes(path.read_bytes()[:-1])
    assert recordings.load(path) is None


def test_the_tour_stays_on_free_ground_on_every_floor_and_within_its_budget():
    navigation = NavigationMap.build(open_building("parametric_house", seed=0))
    tour = Tour(240, math.radians(30), 0.25)
    states = states_of(navigation, tour)
    assert states == states_of(navigation, tour)
    assert 120 <= len(states) <= 240
    assert [s.seq for s in states] == list(range(1, len(states) + 1))
    assert {s.floor for s in states} == {name for name, area in navigation.robot_area.items() if area.any()}
    assert all(navigation.is_navigable(s.p_world, s.floor) for s in states)
    assert {s.pitch_rad for s in states} == {0.0, recordings.LOOK_DOWN_RAD}
    for a, b in itertools.pairwise(states):  # as a robot moves: it turns, or goes, never far
        if a.floor == b.floor and a.yaw_rad == b.yaw_rad:
            assert math.dist(a.p_world, b.p_world) <= tour.step_m + 1e-9
