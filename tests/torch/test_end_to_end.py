"""A robot that searches with the paper's three networks, tiny and trained on its home, all services over Zenoh."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from surveilnav.contract import OBJECTS, ROBOT_STATUS
from surveilnav.messages import FINISHED_STATES
from tests.e2e.conftest import System, starting
from tests.torch.conftest import WORDS


@pytest.fixture
def search_with_paper(
    tmp_path: Path, home_cache: Path, monkeypatch: pytest.MonkeyPatch, tiny_home_detector: Path, tiny_clip: Path,
    folder_of: Callable[..., Path],
) -> Iterator[System]:  # fmt: skip
    models = {
        "DETECTOR": tiny_home_detector,
        "SEGMENTER": folder_of("mobile_sam_onnx"),
        "EMBEDDER": tiny_clip,
        "THRESHOLD": 0.5,
    }
    for setting, value in models.items():
        monkeypatch.setenv(f"SURVEILNAV_PERCEPTION__{setting}", str(value))
    monkeypatch.setenv("SURVEILNAV_FUSION__PROMPTS", json.dumps(WORDS))
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
