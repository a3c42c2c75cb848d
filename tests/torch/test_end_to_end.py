"""A robot that searches with the paper's three networks, tiny and trained on its home, all services over Zenoh."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from matplotlib.path import Path as MatplotlibPath

from surveilnav.contract import MAP_LAYER, OBJECTS, ROBOT_STATUS
from surveilnav.messages import FINISHED_STATES
from surveilnav.sensing.layers import unpack_layer
from surveilnav.simulator.world.scene import Instance
from tests.e2e.conftest import System, starting
from tests.torch.conftest import ROOM_TEXTS, WORDS


@pytest.fixture
def search_with_paper(
    tmp_path: Path,
    home_cache: Path,
    monkeypatch: pytest.MonkeyPatch,
    tiny_home_detector: Path,
    tiny_clip: Path,
    folder_of: Callable[..., Path],
) -> Iterator[System]:
    models = {
        "DETECTOR": tiny_home_detector,
        "SEGMENTER": folder_of("mobile_sam_onnx"),
        "EMBEDDER": tiny_clip,
        "THRESHOLD": 0.5,
    }
    for setting, value in models.items():
        monkeypatch.setenv(f"SURVEILNAV_PERCEPTION__{setting}", str(value))
    with starting(tmp_path, home_cache) as start:
        yield start(cameras=1, perception="paper")


@pytest.mark.slow
def test_it_stops_in_front_of_what_a_tiny_grounding_dino_finds(search_with_paper: System) -> None:
    system = search_with_paper
    system.search("couch", max_steps=300)
    status = system.wait(lambda m: m.state in FINISHED_STATES, 240)
    assert (status.state, status.found) == ("done", True), status
    pose = system.node.ask(ROBOT_STATUS, robot=status.robot).message.T_world_base
    couch = next(instance for instance in system.building.scene.instances if instance.label == "couch")
    here = np.array(pose.translation_m[:2])
    nearest = np.clip(here, couch.p_min[:2], couch.p_max[:2])
    assert np.linalg.norm(here - nearest) <= 1.1  # [m]: success is within 0.1 m of where it can be seen from a metre
    objects = system.node.ask(OBJECTS, floor=status.floor).message.objects
    found = next(thing for thing in objects if thing.id == status.object_id)
    assert found.label == "couch"
    # prompts came from the mission, masks cut the couch out, and CLIP's value map says in which room couches stand
    assert {event.label for thing in objects for event in thing.history} == {"couch"}
    assert all(wide <= 1.5 * there for wide, there in zip(found.size_m[:2], _size_m(couch), strict=True)), found.size_m
    for word, room in zip(WORDS, ROOM_TEXTS, strict=True):
        values = {name: _mean_value(system, status.floor, word, name) for name in ROOM_TEXTS}
        assert max(values, key=lambda name: values[name]) == room, (word, values)


def _size_m(instance: Instance) -> tuple[float, float]:
    return instance.p_max[0] - instance.p_min[0], instance.p_max[1] - instance.p_min[1]


def _mean_value(system: System, floor: str, target: str, room: str) -> float:
    """The mean of a target's value layer over a room."""
    answer = system.node.ask(MAP_LAYER, floor=floor, layer="value", parameters={"target": target}, timeout_s=10.0)
    values, grid = unpack_layer("value", answer.message, answer.payload), answer.message.grid
    rows, columns = np.indices(values.shape)
    xy = grid.centres_of(np.stack([rows.ravel(), columns.ravel()], axis=1))
    polygon = next(r.polygon_m for r in system.building.scene.rooms if r.name == room)
    inside = MatplotlibPath(polygon).contains_points(xy).reshape(values.shape)
    return float(np.nanmean(values[inside]))
