"""What docs/extend shows runs: the code of each page, in the place that the page says it is for."""

from __future__ import annotations

import math
import os
import re
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
import pytest

from surveilnav.benchmark import canary
from surveilnav.benchmark.policies import POLICIES
from surveilnav.bus import Refused, clock_ns
from surveilnav.contract import CAMERA_FRAME, ROBOT_COMMAND, ROBOT_HALT, ROBOT_OBSERVATION
from surveilnav.geometry import Pinhole
from surveilnav.messages import Command, Halt
from surveilnav.sensing.packing import decode_frame
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.service import RobotService
from tests.waiting import patient, until

ROOT = Path(__file__).parents[1]
PAGES = sorted(p for p in (ROOT / "docs" / "extend").glob("*.md") if p.stem != "README")


def code_of(name: str) -> dict[str, Any]:
    """What a page's Python blocks define, run one after the other."""
    page = ROOT / "docs" / "extend" / f"{name}.md"
    blocks = re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)
    assert blocks, f"{page} shows no Python"
    defined: dict[str, Any] = {"__name__": f"docs.extend.{name}"}
    for block in blocks:
        exec(compile(block, str(page), "exec"), defined)
    return defined


@pytest.fixture
def client(make_node):
    return patient(make_node("test", "t", alive=False))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_a_page_is_short(page):
    assert len(page.read_text().splitlines()) <= 110


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_tests_that_a_page_names_exist(page):
    named = re.findall(r"tests/[\w/]+(?:\.py)?", page.read_text())
    assert named
    for path in named:
        assert (ROOT / path).exists(), f"there is no {path}"
    for function in re.findall(r"`(test_\w+)`", page.read_text()):
        sources = [(ROOT / path).read_text() for path in named if path.endswith(".py")]
        assert any(f"def {function}(" in source for source in sources), f"there is no {function} in {named}"


def test_a_detector_finds_what_it_is_made_for():
    page = code_of("detector")
    found = page["Blue"]("blue", None).detect(page["rgb"])
    assert found.xyxy.tolist() == [[240.0, 180.0, 400.0, 280.0]]
    nothing = page["Blue"]("blue", None).detect(np.zeros((48, 64, 3), np.uint8))
    assert len(nothing) == 0


def test_a_policy_searches(monkeypatch):
    widest = code_of("policy")["WIDEST"]
    monkeypatch.setitem(POLICIES, widest.name, widest)
    alone = next(s for s in canary.read().searches if s.name == "alone")
    run = {"surveillance": False, "policy": widest.name, "max_steps": 60}
    ours = canary.play(msgspec.structs.replace(alone, run={**run, "policy": "surveilnav"}))
    theirs = canary.play(msgspec.structs.replace(alone, run=run))
    assert theirs.steps <= 60
    assert "F" in theirs.actions
    assert theirs.actions != ours.actions


def test_a_camera_source_is_put_on_the_bus(make_node, client, tmp_path):
    page = code_of("camera-source")
    source = page["FolderSource"](tmp_path, page["PLACE"], page["VIEWS"], page["INTRINSICS"])
    assert source.version(0) is None
    service = CameraService(make_node("camera", "hall"), source, CameraSettings())
    slot = client.latest(CAMERA_FRAME, floor="0", camera="hall", view=0)

    def shoot(grey, depth_mm, at_ns):
        cv2.imwrite(str(tmp_path / "0.jpg"), np.full((480, 640, 3), (grey, grey, 250), np.uint8))
        cv2.imwrite(str(tmp_path / "0.png"), np.full((480, 640), depth_mm, np.uint16))
        os.utime(tmp_path / "0.png", ns=(at_ns, at_ns))

    assert not service.step()
    shoot(40, 2500, at_ns=10**18)
    for depth_m in (2.5, 3.0):
        until(service.step)
        frame = until(slot.poll)
        view = decode_frame(frame.message, frame.payload)
        assert view.depth_m[240, 320] == pytest.approx(depth_m, abs=0.01)
        assert view.rgb[240, 320, 0] > 200, "red is red"
        shoot(90, 3000, at_ns=10**18 + 1_000_000)
    assert view.T_world_camera[:3, 3] == pytest.approx(page["POSITION_M"])
    assert view.floor_z_m == pytest.approx(0.0)


class Drive:
    """A driver that runs into something at x = 0.3 m."""

    def __init__(self):
        self.x_m, self.yaw_rad, self.done = 0.0, 0.0, []

    def do(self, action):
        self.done.append(action)
        self.x_m = min(0.3, self.x_m + 0.25 * (action == "move_forward"))
        self.yaw_rad += math.radians(30) * ((action == "turn_left") - (action == "turn_right"))

    def brake(self):
        self.done.append("brake")

    def pose(self):
        return self.x_m, 0.0, self.yaw_rad

    def look(self):
        return np.full((48, 64, 3), 70, np.uint8), np.full((48, 64), 2.0, np.float32)


def test_a_robot_body_obeys(make_node, client):
    drive = Drive()
    body = code_of("robot-body")["DrivenBody"](drive, Pinhole.from_hfov(64, 48, 1.2))
    service = RobotService(make_node("robot", "r1"), body, RobotSettings(id="r1"))
    observations = client.latest(ROBOT_OBSERVATION, robot="r1")

    def command(action, seq, **more):
        message = Command(stamp_ns=clock_ns(), action=action, seq_expected=seq, mission="m1", **more)
        return client.ask(ROBOT_COMMAND, message, robot="r1").message

    actions = ["move_forward", "move_forward", "turn_left", "look_down"]
    for seq, action in enumerate(actions):
        assert command(action, seq).accepted
        assert service.step()
        seen = until(observations.poll).message
        assert (seen.seq, seen.last_action, seen.collided) == (seq + 1, action, seq == 1)
    assert seen.path_m == pytest.approx(0.3)
    assert seen.T_world_camera.translation_m == pytest.approx((0.3, 0.0, 0.88))
    assert not command("turn_left", 2).accepted, "its number is past"
    with pytest.raises(Refused, match="can't take_stairs"):
        command("take_stairs", 4, to_floor="1")
    assert command("stop", 4).accepted
    assert client.ask(ROBOT_HALT, Halt(stamp_ns=clock_ns(), halted=True), robot="r1").message.halted
    assert drive.done == [*actions[:3], "brake"]
    assert body.state.stopped
