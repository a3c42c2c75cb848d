"""A camera of cameras.yaml as a process: its entry may be changed, broken and removed while it runs."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import pytest

from surveilnav.bus import BusSettings, Node, Unanswered
from surveilnav.bus.main import ENDS_WITH_STDIN
from surveilnav.contract import CAMERA_INFO
from surveilnav.messages import CameraInfo
from tests import streams
from tests.waiting import until

FILE = """\
floors: {ground: {z_m: 0.0}}
cameras:
  - name: hall
    label: Halle Süd
    floor: ground
    stream: pictures
    position_m: [1, 2, 2.5]
    yaw_deg: 0
    lens: {width_px: 320, height_px: 240, hfov_deg: 80}
"""


@pytest.fixture
def file(tmp_path: Path) -> Iterator[Path]:
    """A file of cameras whose only camera gets pictures from a folder, five a second."""
    (tmp_path / "pictures").mkdir()
    ended = threading.Event()

    def write() -> None:
        t = 0
        while not ended.wait(0.2):
            t += 1
            part = tmp_path / "pictures" / f"{t % 5}.part"
            part.write_bytes(cv2.imencode(".jpg", streams.room(t)[..., ::-1])[1])
            part.rename(part.with_suffix(".jpg"))

    writer = threading.Thread(target=write, daemon=True)
    writer.start()
    path = tmp_path / "cameras.yaml"
    path.write_text(FILE, encoding="utf-8")
    yield path
    ended.set()
    writer.join()


@pytest.fixture
def camera(file: Path, bus: BusSettings) -> Iterator[subprocess.Popen[bytes]]:
    with started(file, bus) as process:
        yield process


@contextmanager
def started(file: Path, bus: BusSettings, health_file: Path | None = None) -> Iterator[subprocess.Popen[bytes]]:
    """A camera node's process, which takes any free camera of the file. While none is free, it touches ``health_file``."""
    variables = {
        **({"SURVEILNAV_BUS__HEALTH_FILE": str(health_file)} if health_file else {}),
        "SURVEILNAV_BUS__ROUTER": str(bus.router),
        "SURVEILNAV_BUS__BUILDING": bus.building,
        "SURVEILNAV_CAMERA__FILE": str(file),
        ENDS_WITH_STDIN: "1",
    }
    command = [sys.executable, "-m", "surveilnav.services.camera_node"]
    process = subprocess.Popen(command, env={**os.environ, **variables}, stdin=subprocess.PIPE)
    yield process
    process.terminate()
    process.wait(10)


def test_an_entry_is_changed_broken_mended_and_removed(
    file: Path,
    camera: subprocess.Popen[bytes],
    make_node,  # type: ignore[no-untyped-def]
) -> None:
    client: Node = make_node("test", "t", alive=False)

    def info() -> CameraInfo | None:
        try:
            return client.ask(CAMERA_INFO, floor="ground", camera="hall").message
        except Unanswered:
            return None

    def looks_along(axis: int) -> bool:
        told = info()
        return told is not None and abs(told.views[0].T_world_camera.matrix()[axis, 2]) > 0.99

    until(lambda: (told := info()) is not None and told.stream.state == "live", info, timeout_s=30.0)
    first = info()
    assert first is not None
    assert (first.label, first.tier, first.mounting_offset_m) == ("Halle Süd", "jpeg", 2.5)
    assert looks_along(0)
    file.write_text(FILE.replace("yaw_deg: 0", "yaw_deg: 90"), encoding="utf-8")
    until(lambda: looks_along(1), info, timeout_s=30.0)
    file.write_text(FILE.replace("yaw_deg: 0", "yaw_deg: north"), encoding="utf-8")
    time.sleep(3.0)
    assert looks_along(1), "an entry with a mistake changes nothing"
    file.write_text(FILE.replace("name: hall", "name: other"), encoding="utf-8")
    until(lambda: info() is None, info, timeout_s=30.0)
    until(lambda: "other" in client.alive("camera"), lambda: client.alive("camera"), timeout_s=30.0)
    assert camera.poll() is None


def test_a_spare_process_outlives_a_broken_file_and_takes_a_camera_that_is_added(
    file: Path,
    camera: subprocess.Popen[bytes],
    bus: BusSettings,
    make_node,  # type: ignore[no-untyped-def]
) -> None:
    client: Node = make_node("test", "t", alive=False)
    until(lambda: client.alive("camera") == {"hall"}, lambda: client.alive("camera"), timeout_s=30.0)
    waiting = file.parent / "healthy"
    with started(file, bus, waiting) as spare:
        until(waiting.exists, "the spare process waits for a camera", timeout_s=60.0)
        file.write_text("cameras: [", encoding="utf-8")
        time.sleep(5.0)
        assert (camera.poll(), spare.poll()) == (None, None)
        assert client.alive("camera") == {"hall"}, "what can't be read changes nothing"
        file.unlink()
        time.sleep(3.0)
        assert (camera.poll(), spare.poll()) == (None, None)
        entry = FILE[FILE.index("  - name") :]
        file.write_text(FILE + entry.replace("name: hall", "name: gate"), encoding="utf-8")
        until(lambda: client.alive("camera") == {"hall", "gate"}, lambda: client.alive("camera"), timeout_s=30.0)
