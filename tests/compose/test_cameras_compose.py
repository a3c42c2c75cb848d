"""compose.cameras.yaml on a real Docker engine: a camera of a file, nothing simulated, and no robot."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.compose.stack import UP_S, Stack, missing

pytestmark = [pytest.mark.compose, pytest.mark.slow, pytest.mark.timeout(UP_S + 300)]
_FILE = """
building: hq
floors: {ground: {z_m: 0}}
cameras:
  - {name: hall, label: Hall, floor: ground, stream: pictures, position_m: [0, 0, 2.5], yaw_deg: 0, pitch_deg: -30,
     lens: {width_px: 320, height_px: 240, hfov_deg: 90}}
"""


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    if why := missing():
        pytest.skip(f"no Docker engine with Compose v2 here ({why})")
    folder = tmp_path_factory.mktemp("cameras")
    (folder / "cameras.yaml").write_text(_FILE, encoding="utf-8")
    (folder / "pictures").mkdir()
    write_picture(folder)
    for path in (folder, *folder.rglob("*")):  # containers run as another user
        path.chmod(0o755 if path.is_dir() else 0o644)
    models = tmp_path_factory.mktemp("models")
    models.chmod(0o755)
    stack = Stack(
        models,
        "compose.cameras.yaml",
        SURVEILNAV_CAMERAS_DIR=str(folder),
        SURVEILNAV_PERCEPTION__BACKEND="compact",
    )
    stack.folder = folder
    with stack.running():
        yield stack


def write_picture(folder: Path) -> None:
    picture = np.random.default_rng(time.time_ns()).integers(40, 200, (240, 320, 3), np.uint8)
    part = folder / "pictures" / "part"
    part.write_bytes(cv2.imencode(".jpg", picture)[1].tobytes())
    part.chmod(0o644)
    part.rename(folder / "pictures" / f"{time.time_ns()}.jpg")


def test_a_camera_of_the_file_runs_and_is_asked(stack: Stack) -> None:
    deadline_s = time.monotonic() + 60.0
    while not (live := [c for c in stack.get("/api/v1/cameras")["items"] if c["stream"]["state"] == "live"]):
        assert time.monotonic() < deadline_s, stack.state()
        write_picture(stack.folder)
        time.sleep(1.0)
    assert [(c["id"], c["label"]) for c in live] == [("hall", "Hall")]
    answer = stack.gateway.post("/api/v1/sightings", json={"target": "couch"}, timeout=120.0)
    assert answer.status_code == 200, answer.text
    assert [(c["id"], c["views"]) for c in answer.json()["cameras"]] == [("hall", 1)], stack.state()
