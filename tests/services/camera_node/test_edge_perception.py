"""A camera's own perception and its summary, over real Zenoh, with a building and a backend made here."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from surveilnav.contract import CAMERA_FRAME, CAMERA_REQUEST, CAMERA_SUMMARY, TRAFFIC
from surveilnav.errors import PerceptionError
from surveilnav.messages import CameraRequest, ModelIds
from surveilnav.perception.names import BackendName
from surveilnav.perception.vocabulary import COCO
from surveilnav.sensing.views import DetectedObject, ViewPerception
from surveilnav.services.camera_node import edge_perception as edge_perception_module
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.edge_perception import EdgePerception, open_edge_perception
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.service import CameraService
from surveilnav.simulator.truth.backends import Oracle
from tests.waiting import patient, until

QUICK = CameraSettings(perception="oracle", look_period_s=0.01)


class Watcher:
    """A real backend as far as anybody can tell: it gets no truth, and says what the test wants."""

    name, why, embedding_dim, needs_truth, may_know = "watcher", "a test", 81, False, False
    models = ModelIds()

    def __init__(self, labels=("tv",), hold=None, fails=0):
        self.labels, self.hold, self.fails, self.looks, self.nice = labels, hold, fails, [], None

    def perceive(self, rgb, depth_m, camera, *, prompts=(), truth=None, key=()):
        assert truth is None or self.may_know, "a real detector was told the truth"
        self.looks.append(key[1])
        self.nice = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
        if self.hold is not None:
            self.hold.wait(20.0)
        if len(self.looks) <= self.fails:
            raise PerceptionError("out of sorts")
        scores = [(label, 0.5 + 0.01 * key[1]) for label in self.labels]
        box = (0.0, 0.0, 9.0, 9.0)
        found = tuple(
            DetectedObject(label, score / 2, box, None, np.zeros(81, np.float32), score) for label, score in scores
        )
        return ViewPerception(self.name, found, np.zeros(81, np.float32))


@pytest.fixture
def start(camera_node, make_camera):
    """``start(backend)``: edge perception that runs; it is closed at the test's end."""
    opened = []

    def start(backend, settings=QUICK, busy=lambda: False, camera=None):
        watched = camera or make_camera()
        perception = EdgePerception(camera_node, watched, settings, OwnPerception(watched, lambda: backend), busy)
        opened.append(perception)
        perception.start()
        return perception

    yield start
    for perception in opened:
        perception.close()


def summaries(node):
    """A list that every summary put from now on is added to."""
    got = []
    return SimpleNamespace(messages=got, subscription=node.subscribe(CAMERA_SUMMARY, got.append))


def test_it_tells_what_it_saw_though_nobody_invoked_it(start, make_node):
    heard = summaries(make_node("test", "t", alive=False))
    watcher = Watcher()
    start(watcher)
    row = until(lambda: next((r for r in heard.messages if r.message.labels.get("tv") == 0.61), None))
    assert row.ids == {"building": "test", "floor": "0", "camera": "c1"}
    assert (row.message.camera, row.message.floor) == ("c1", "0")
    assert sorted(watcher.looks) == list(range(12)), "each view once, the one straight down never"


@pytest.mark.parametrize(("needs_truth", "looks_again"), [(False, []), (True, list(range(12)))])
def test_the_next_run_knows_what_was_seen_unless_the_truth_was_told(
    start, make_node, make_camera, tmp_path, monkeypatch, needs_truth, looks_again
):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    first, second, other = Watcher(), Watcher(), Watcher()
    for watcher in (first, second, other):
        watcher.needs_truth, watcher.may_know = needs_truth, needs_truth
    settings = QUICK if needs_truth else QUICK.model_copy(update={"perception": "compact"})
    start(first, settings, camera=make_camera(scene="home"))
    until(lambda: len(first.looks) == 12)
    heard = summaries(make_node("test", "t", alive=False))
    start(second, settings, camera=make_camera(scene="home"))
    until(lambda: next((r for r in heard.messages if r.message.labels.get("tv") == 0.61), None))
    until(lambda: sorted(second.looks) == looks_again)
    start(other, settings, camera=make_camera(scene="another"))
    until(lambda: len(other.looks) == 12)


@pytest.mark.parametrize("other", ["perception", "weights", "program"])
def test_other_eyes_look_themselves(start, make_camera, tmp_path, monkeypatch, other):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    first, second = Watcher(), Watcher()
    usual = QUICK.model_copy(update={"perception": "compact"})
    start(first, usual, camera=make_camera(scene="home"))
    until(lambda: len(first.looks) == 12)
    settings = QUICK.model_copy(update={"perception": "onnx-coco"}) if other == "perception" else usual
    if other == "weights":
        monkeypatch.setattr(edge_perception_module.models, "small_weights", lambda: ("compact@another",))
    if other == "program":
        monkeypatch.setattr("surveilnav.services.camera_node.result_cache.code_fingerprint", lambda *names: "another")
    start(second, settings, camera=make_camera(scene="home"))
    until(lambda: len(second.looks) == 12)


def test_a_busy_camera_tells_nothing_of_what_it_saw_in_an_earlier_run(start, make_camera, tmp_path, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    first, settings = Watcher(), QUICK.model_copy(update={"perception": "compact"})
    start(first, settings, camera=make_camera(scene="home"))
    until(lambda: len(first.looks) == 12)
    paused = start(Watcher(), settings, busy=lambda: True, camera=make_camera(scene="home"))
    time.sleep(0.3)
    assert paused._examined == {}


def test_oracle_is_told_the_truth(start, make_node):
    heard = summaries(make_node("test", "t", alive=False))
    start(Oracle())
    assert until(lambda: next((r.message.labels for r in heard.messages if r.message.labels), None)) == {"bed": 1.0}


def test_it_gives_way_to_the_rest_of_the_camera(start):
    watcher = Watcher()
    start(watcher)
    until(lambda: watcher.looks)
    until(lambda: watcher.nice is not None)
    assert watcher.nice == min(19, os.getpriority(os.PRIO_PROCESS, 0) + 10)


def test_while_frames_are_sent_no_look_begins(start):
    watcher, sending = Watcher(), threading.Event()
    sending.set()
    start(watcher, busy=sending.is_set)
    time.sleep(0.3)
    assert watcher.looks == []
    sending.clear()
    until(lambda: len(watcher.looks) == 12)


def test_a_slow_look_delays_neither_frames_nor_thumbnails(start, camera_node, make_node, make_camera):
    hold = threading.Event()
    service = CameraService(camera_node, make_camera(), QUICK)
    client = patient(make_node("test", "t", alive=False))
    watcher = Watcher(hold=hold)
    start(watcher)
    until(lambda: watcher.looks)  # it looks, and will for a long time
    slots = [client.latest(CAMERA_FRAME, floor="0", camera="c1", view=v) for v in range(13)]
    loop = threading.Thread(target=lambda: camera_node.run(service.step, idle_s=0.02), daemon=True)
    loop.start()
    missing = set(range(13))

    def arrived():
        missing.difference_update(v for v in list(missing) if slots[v].poll())
        return not missing

    until(arrived)
    request = CameraRequest(stamp_ns=1, action="thumbnail", views=[3])
    picture = client.ask(CAMERA_REQUEST, request, floor="0", camera="c1")
    assert picture.payload.startswith(b"\xff\xd8")
    assert watcher.looks == [0], "all the while it looked at one view"
    hold.set()
    until(lambda: len(watcher.looks) == 12)
    camera_node.stop()
    loop.join(5)


def test_uninvoked_it_stays_under_a_kilobyte_a_second(start, camera_node, make_node, make_camera):
    """With the longest summary, news all the time, and somebody who reads its traffic figures."""
    listener = make_node("test", "t", alive=False)
    heard = summaries(listener)
    traffic = listener.table(TRAFFIC)
    service = CameraService(camera_node, make_camera(), QUICK)
    start(Watcher(labels=COCO), CameraSettings(perception="oracle", look_period_s=0.5))
    until(lambda: heard.messages and traffic.rows())

    def offered():
        return sum(r.n_bytes for r in camera_node.traffic.rows() if r.direction == "offered")

    began_s, began = time.monotonic(), offered()
    while time.monotonic() - began_s < 6.5:  # news all the while: a view in half a second
        service.step()
        time.sleep(0.02)
    rate = (offered() - began) / (time.monotonic() - began_s)
    assert 150 < rate < 1000, f"{rate:.0f} B/s"
    assert len(heard.messages) >= 3, "the news was told"
    assert not [r for r in camera_node.traffic.rows() if "/frame/" in r.key]


def test_after_the_news_it_keeps_its_rate(start, make_node, camera_node):
    heard = summaries(make_node("test", "t", alive=False))
    watcher = Watcher()
    start(watcher)
    until(lambda: len(watcher.looks) == 12)
    until(lambda: heard.messages and heard.messages[-1].message.labels == {"tv": 0.61})
    n = len(heard.messages)
    until(lambda: len(heard.messages) > n, timeout_s=7.0)
    first, second = heard.messages[n - 1], heard.messages[n]
    assert 4.0 < (second.received_ns - first.received_ns) / 1e9 < 6.0
    assert second.message.labels == first.message.labels


def test_a_detector_that_cannot_run_is_named_and_the_camera_goes_on(start, camera_node, monkeypatch):
    monkeypatch.setattr(edge_perception_module, "_RETRY_S", 0.1)
    watcher = Watcher(fails=1)
    perception = start(watcher)
    until(lambda: len(watcher.looks) > 2)
    assert watcher.looks[:2] == [0, 0], "the view is looked at again"
    assert camera_node.traffic.rejected() == {"own perception": 1}
    assert perception._thread.is_alive()


def test_a_camera_takes_every_backend_s_name_and_no_other():
    looks = {name for name in BackendName if CameraSettings(perception=name).runs_perception}
    assert looks == {"auto", "compact", "onnx-coco", "oracle", "simulated"}
    assert not CameraSettings().runs_perception
    with pytest.raises(ValidationError):
        CameraSettings(perception="magic")


def test_who_does_not_choose_a_floor_loads_no_detector(camera_node, make_camera):
    camera = make_camera()
    own = OwnPerception(camera, Oracle)

    def opened(n_floors, **settings):
        return open_edge_perception(
            camera_node, camera, CameraSettings(**settings), own=own, n_floors=n_floors, busy=lambda: False
        )

    for name in ("paper", "yolo-world"):
        with opened(2, perception=name) as perception:
            assert perception is None, "large models run in the perception service alone"
    with opened(2, perception="none") as perception:
        assert perception is None
    with opened(1, perception="oracle") as perception:
        assert perception is None
    with opened(1, perception="oracle", min_floors=1) as perception:
        assert perception._thread.is_alive()
    assert not perception._thread.is_alive()
    code = "import sys, surveilnav.services.camera_node.__main__; print([m for m in sys.modules if 'onnx' in m or 'choose' in m])"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert run.stdout.strip() == "[]", "the networks' runtime is loaded without need"
