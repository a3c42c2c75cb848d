"""What a robot took for the target: the thing that the points of the object lie on."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.studies import taken
from surveilnav.errors import ConfigError
from surveilnav.messages import ObjectRecord
from surveilnav.simulator.plans.parametric_homes import parametric_flat
from surveilnav.simulator.world.raycast import RayCaster


@pytest.fixture(scope="module")
def flat():
    scene = parametric_flat(0)
    return scene, RayCaster(scene)


def seen_at(points) -> ObjectRecord:
    return ObjectRecord(
        id=1,
        floor="0",
        label="tv",
        status="confirmed",
        confidence=0.9,
        confidence_robot=0.9,
        confidence_surveillance=0.0,
        label_robot="tv",
        label_surveillance="",
        n_detections=3,
        n_points=len(points),
        center_m=tuple(map(float, points[0])),
        size_m=(1.0, 1.0, 1.0),
        first_seen_ns=0,
        last_seen_ns=1,
        sources=["robot/r1"],
        reason="",
        points=np.asarray(points, np.float32).tobytes(),
    )


def on(scene, thing, n=5):
    """The centres of some of a thing's triangles, 2 cm off."""
    return scene.vertices[scene.triangles[scene.instance_of_triangle == thing.id][:n]].mean(axis=1) + 0.02


def test_most_points_say_which_thing_it_is(flat):
    scene, caster = flat
    bed, chair, wall = (scene.labelled(label)[0] for label in ("bed", "chair", "wall"))
    points = np.concatenate([on(scene, bed), on(scene, chair, 3)])
    assert taken.thing_named(scene, caster, seen_at(points)).startswith("bed")
    assert taken.thing_named(scene, caster, seen_at(points[::-1][:3])).startswith("chair")
    assert taken.thing_named(scene, caster, seen_at(on(scene, wall))) == "wall", "a wall's number says nothing"
    bare = dataclasses.replace(scene, instances=())
    assert taken.thing_named(bare, caster, seen_at(points)) == ""


def test_a_search_that_comes_out_otherwise_is_refused():
    facts = {
        "scene": "a",
        "episode_id": "4",
        "category": "bed",
        "success": False,
        "spl": 0.0,
        "soft_spl": 0.0,
        "steps": 9,
        "path_m": 3.0,
        "shortest_path_m": 2.0,
        "distance_m": 1.0,
        "reason": "false_positive",
        "seen": True,
        "bytes": {},
        "seconds": 1.0,
    }
    record = EpisodeRecord(**facts)
    taken.check_same(record, EpisodeRecord(**facts | {"seconds": 5.0}))
    with pytest.raises(ConfigError, match=r"took 9 steps .* now 8"):
        taken.check_same(record, EpisodeRecord(**facts | {"steps": 8}))


def test_what_the_command_said_is_read_or_refused(tmp_path):
    path = tmp_path / "taken.json"
    path.write_text(json.dumps({"taken": [{"scene": "a", "episode_id": "4", "taken": "oven"}]}))
    assert taken.read_taken(path) == {("a", "4"): "oven"}
    path.write_text("[]")
    with pytest.raises(ConfigError, match="isn't what"):
        taken.read_taken(path)
