"""compose.cameras.yaml on a real Docker engine: cameras of a file, nothing simulated, and no robot."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests import streams
from tests.compose.stack import UP_S, Stack, create_security, host_as_containers_see_it, missing

pytestmark = [pytest.mark.compose, pytest.mark.slow, pytest.mark.timeout(UP_S + 300)]
_FILE = """
building: {building}
floors: {{ground: {{z_m: 0}}}}
cameras:
  - {{name: hall, label: Hall, floor: ground, stream: pictures, position_m: [0, 0, 2.5], yaw_deg: 0, pitch_deg: -30,
     lens: {{width_px: 320, height_px: 240, hfov_deg: 90}}}}
  - {{name: door, label: Door, floor: ground, stream: "{address}/door.mp4", position_m: [3, 0, 2.5], yaw_deg: 90, pitch_deg: -30,
     lens: {{width_px: 320, height_px: 240, hfov_deg: 90}}}}
"""
_IDENTITIES = ("router", "fusion", "gateway", "perception", "cameras")


@pytest.fixture(scope="module", params=["open", "secure"])
def stack(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    """Two cameras, one of them a real RTSP stream: without security, then with certificates and keys."""
    if why := missing():
        pytest.skip(f"no Docker engine with Compose v2 here ({why})")
    secure = request.param == "secure"
    if secure and os.geteuid() != 0:
        pytest.skip("secrets are given to the containers' user, which needs root")
    folder, security = tmp_path_factory.mktemp("cameras"), tmp_path_factory.mktemp("secrets") / "security"
    (folder / "pictures").mkdir()
    write_picture(folder)
    videos = tmp_path_factory.mktemp("videos")
    streams.write_looped_video(videos / "door.mp4", [picture() for _ in range(10)], 600.0, 5)
    headers = {}
    if secure:
        headers["Authorization"] = f"Bearer {create_security(security, _IDENTITIES)['operator']}"
    with streams.rtsp_server(videos, host_as_containers_see_it()) as (address, _):
        # the identities are for a building named "building"
        (folder / "cameras.yaml").write_text(_FILE.format(address=address, building="building"), encoding="utf-8")
        for path in (folder, *folder.rglob("*")):  # containers run as another user
            path.chmod(0o755 if path.is_dir() else 0o644)
        models = tmp_path_factory.mktemp("models")
        models.chmod(0o755)
        stack = Stack(
            models,
            "compose.cameras.yaml",
            *(("compose.secure.yaml", "compose.cameras.secure.yaml") if secure else ()),
            SURVEILNAV_CAMERAS_DIR=str(folder),
            SURVEILNAV_SECURITY_DIR=str(security),
            SURVEILNAV_PERCEPTION__BACKEND="compact",
        )
        stack.folder = folder
        stack.gateway.headers.update(headers)
        with stack.running("--scale", "camera=2"):
            yield stack


def picture() -> np.ndarray:
    return np.random.default_rng(time.time_ns()).integers(40, 200, (240, 320, 3), np.uint8)


def write_picture(folder: Path) -> None:
    part = folder / "pictures" / "part"
    part.write_bytes(cv2.imencode(".jpg", picture())[1].tobytes())
    part.chmod(0o644)
    part.rename(folder / "pictures" / f"{time.time_ns()}.jpg")


def test_the_cameras_of_the_file_run_and_are_asked(stack: Stack) -> None:
    deadline_s = time.monotonic() + 60.0
    while len(live := [c for c in stack.get("/api/v1/cameras")["items"] if c["stream"]["state"] == "live"]) < 2:
        assert time.monotonic() < deadline_s, stack.state()
        write_picture(stack.folder)
        time.sleep(1.0)
    assert sorted((c["id"], c["label"]) for c in live) == [("door", "Door"), ("hall", "Hall")]
    answer = stack.gateway.post("/api/v1/sightings", json={"target": "couch"}, timeout=120.0)
    assert answer.status_code == 200, answer.text
    views = {c["id"]: c["views"] for c in answer.json()["cameras"]}
    assert views == {"hall": 1, "door": 1}, stack.state()


def test_the_images_hold_no_simulator(stack: Stack) -> None:
    names = {c["Image"] for c in stack.containers()}
    assert names == {"surveilnav"}
