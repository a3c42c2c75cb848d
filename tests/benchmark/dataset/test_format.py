"""The files are what Habitat's loader makes of them, and ours are strict."""

from __future__ import annotations

import gzip
import json
import math
import os

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.benchmark.dataset import axes
from surveilnav.benchmark.dataset import format as files
from surveilnav.benchmark.dataset.load import load_scene, scenes_of, start_of
from surveilnav.errors import ConfigError

#: The attributes of habitat-lab's classes; their constructors take keywords and refuse any other
#: (habitat/core/dataset.py, tasks/nav/nav.py, tasks/nav/object_nav_task.py, core/simulator.py).
EPISODE = {
    "episode_id",
    "scene_id",
    "scene_dataset_config",
    "additional_obj_config_paths",
    "start_position",
    "start_rotation",
    "info",
    "_shortest_path_cache",
    "goals",
    "start_room",
    "shortest_paths",
    "object_category",
}
EPISODE_NEEDS = {"episode_id", "scene_id", "start_position", "start_rotation", "goals"}
GOAL = {
    "position",
    "radius",
    "object_id",
    "object_name",
    "object_name_id",
    "object_category",
    "room_id",
    "room_name",
    "view_points",
}


def _json(path):
    return json.loads(gzip.decompress(path.read_bytes()))


def test_habitats_loader_would_take_every_file(dataset):
    """``ObjectNavDatasetV1.from_json``, step by step."""
    index = _json(dataset / "val_mini" / "val_mini.json.gz")
    assert index["episodes"] == []
    for path in sorted((dataset / "val_mini" / "content").glob("*.json.gz")):
        content = _json(path)
        tasks, scenes = content["category_to_task_category_id"], content["category_to_scene_annotation_category_id"]
        assert set(tasks) == set(scenes) == {"chair", "bed", "plant", "toilet", "tv_monitor", "sofa"}
        for goal in (g for goals in content["goals_by_category"].values() for g in goals):
            assert set(goal) <= GOAL
            assert goal["object_id"] is not None
            assert len(goal["position"]) == 3
            for view in goal["view_points"]:
                assert set(view) == {"agent_state", "iou"}
                assert set(view["agent_state"]) == {"position", "rotation"}
        assert content["episodes"]
        for episode in content["episodes"]:
            assert EPISODE_NEEDS <= set(episode) <= EPISODE
            assert episode["goals"] == []
            assert episode["shortest_paths"] is None
            key = f"{os.path.basename(episode['scene_id'])}_{episode['object_category']}"
            assert content["goals_by_category"][key]
            assert math.isclose(np.linalg.norm(episode["start_rotation"]), 1.0, abs_tol=1e-9)
        # the loader finds a scene's episodes by the file's name
        assert os.path.basename(content["episodes"][0]["scene_id"]).partition(".")[0] == path.name.partition(".")[0]


def test_starts_keep_habitats_rules(dataset):
    for scene in scenes_of(dataset, "val_mini"):
        for episode in load_scene(dataset, "val_mini", scene).content.episodes:
            info = episode.info
            assert 0.2 <= info.geodesic_distance <= 30.0
            assert info.geodesic_distance >= 1.05 * info.euclidean_distance - 1e-6


numbers = st.floats(-100, 100)


@given(st.tuples(numbers, numbers, numbers), st.floats(-3.14, 3.14))
def test_axes_there_and_back(p, yaw):
    assert np.allclose(axes.from_habitat(axes.to_habitat(p)), p)
    assert math.isclose(axes.yaw_of(axes.rotation_of(yaw)), yaw, abs_tol=1e-9)


@given(st.floats(-3.14, 3.14))
def test_a_robot_looks_the_same_way_in_habitat(yaw):
    """Habitat's agent looks along -z, turned by its quaternion: the same direction as our (cos, sin)."""
    x, y, z, w = axes.rotation_of(yaw)
    assert (x, z) == (0.0, 0.0)
    turn = 2 * math.atan2(y, w)
    forward = (-math.sin(turn), 0.0, -math.cos(turn))  # of -z turned about +y
    assert np.allclose(axes.from_habitat(forward)[:2], (math.cos(yaw), math.sin(yaw)))


def test_an_unknown_field_is_another_format(tmp_path):
    path = tmp_path / "x.json"
    path.write_text('{"scenes": 1, "floors": 1, "cameras": 1, "episodes": 1, "rooms": 2}')
    with pytest.raises(ConfigError, match="rooms"):
        files.read(path, files.SplitCounts)


def test_another_version_is_refused(tmp_path):
    (tmp_path / "dataset.json").write_text('{"version": 99}')
    with pytest.raises(ConfigError, match="99"):
        files.manifest_of(tmp_path)
    (tmp_path / "dataset.json").write_text("[]")
    with pytest.raises(ConfigError, match="damaged"):
        files.manifest_of(tmp_path)
    with pytest.raises(ConfigError, match="surveilnav dataset build"):
        files.manifest_of(tmp_path / "nowhere")


def test_a_start_comes_back_as_it_was(dataset):
    from surveilnav.benchmark.dataset.build import open_scene

    data = load_scene(dataset, "val_mini", "parametric_house-s1")
    building = open_scene(data.record, lighting="flat")
    for episode in data.content.episodes:
        start = start_of(episode, building.scene)
        goals = data.goals(data.label_of(episode), building.scene, building.navigation)
        assert start.floor in goals.viewpoints
        assert math.isclose(goals.field.at(start.p_m, start.floor), start.shortest_path_m, abs_tol=0.01)
