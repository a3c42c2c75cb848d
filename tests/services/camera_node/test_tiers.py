"""A camera's tiers over real Zenoh: what its frames hold, its budget, and what happens when it can't look by itself."""

from __future__ import annotations

import time

import numpy as np
import pytest

from surveilnav.bus.traffic import WireBytes
from surveilnav.contract import CAMERA_FRAME, CAMERA_INFO, CAMERA_REQUEST
from surveilnav.errors import ConfigError, PerceptionError
from surveilnav.messages import CameraRequest, ModelIds
from surveilnav.perception.backend import Backend
from surveilnav.sensing.packing import decode_frame
from surveilnav.sensing.perceived import perceived_reply
from surveilnav.sensing.views import DetectedObject, ViewPerception
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.core.budget import TokenBucket
from surveilnav.services.camera_node.core.link import Link
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.service import CameraService
from tests.waiting import patient, repeat_until, until

PLACE = {"floor": "0", "camera": "c1"}
UNIT = np.eye(8, dtype=np.float32)


class Looking(Backend):
    """Sees a bed everywhere; ``fails`` so many times before, with an ``error``."""

    name, needs_truth, models = "looking", False, ModelIds(embedder="a space")

    def __init__(self, fails: int = 0, error: Exception | None = None) -> None:
        self.looks, self.fails, self.error = [], fails, error

    @property
    def stages(self):
        raise NotImplementedError

    def embed_texts(self, texts):
        raise NotImplementedError

    def perceive(self, rgb, depth_m, camera, *, prompts=(), truth=None, key=()):
        assert truth is None
        self.looks.append(key[1])
        if len(self.looks) <= self.fails:
            raise self.error
        bed = DetectedObject("bed", 0.9, (8.0, 8.0, 40.0, 40.0), None, UNIT[0], 0.9)
        return ViewPerception("looking", (bed,), UNIT[1], "a space", ("bed", "tv"))


@pytest.fixture
def client(make_node):
    return patient(make_node("test", "t", alive=False))


def listen(client, views):
    """The headers of all frames of these views that come from now on."""
    headers = []
    for view in views:
        client.subscribe(CAMERA_FRAME, lambda frame: headers.append(frame.message), **PLACE, view=view)
    return headers


@pytest.fixture
def start(camera_node, client, make_camera):
    """``start(backend, **settings)``: a camera service to whose first views somebody listens, and the slots of these."""

    def start(backend, views=(3,), **settings):
        camera = make_camera()
        own = OwnPerception(camera, lambda: backend)
        service = CameraService(camera_node, camera, CameraSettings(perception="compact", **settings), own)
        service.camera = camera
        slots = {v: client.latest(CAMERA_FRAME, **PLACE, view=v) for v in views}
        until(lambda: all(service._sender._frames[v].matched for v in views))
        return service, slots

    return start


def test_features_say_what_the_camera_saw(start):
    service, slots = start(Looking(), tier="features")
    assert service.step()
    frame = until(slots[3].poll)
    assert frame.message.tier == "features"
    reply = perceived_reply(frame.message, frame.payload)
    assert (reply.seq, reply.models.embedder, [d.label for d in reply.detections]) == (1, "a space", ["bed"])
    assert decode_frame(frame.message, frame.payload).depth_m == pytest.approx(2.0, abs=0.02)
    assert not service.step()


def test_a_view_from_above_isnt_looked_at(start):
    backend = Looking()
    service, slots = start(backend, views=(12,), tier="features")
    service.step()
    frame = until(slots[12].poll)
    assert (frame.message.tier, frame.message.perceived) == ("features", None)
    assert backend.looks == []


def test_whoever_wants_the_pictures_gets_them_as_long_as_it_listens(start, client):
    service, slots = start(Looking(), tier="features")
    service.step()
    until(slots[3].poll)
    request = CameraRequest(stamp_ns=1, action="resend", views=[3], pictures=True)
    client.ask(CAMERA_REQUEST, request, **PLACE)
    assert service.step()
    whole = until(slots[3].poll)
    assert (whole.message.tier, whole.message.seq, whole.message.perceived) == ("jpeg+depth", 2, None)
    assert decode_frame(whole.message, whole.payload).rgb.shape == (64, 64, 3)
    assert not service.step()
    slots[3].close()
    until(lambda: not service._sender._frames[3].matched)
    service.step()
    again = client.latest(CAMERA_FRAME, **PLACE, view=3)
    until(lambda: service._sender._frames[3].matched)
    service.step()
    assert until(again.poll).message.tier == "features"


@pytest.mark.parametrize("error", [PerceptionError("out of sorts"), RuntimeError("of ONNX Runtime")])
def test_a_camera_that_cant_look_by_itself_sends_pictures(start, camera_node, error):
    service, slots = start(Looking(fails=99, error=error), tier="features")
    service.step()
    assert until(slots[3].poll).message.tier == "jpeg+depth"
    assert camera_node.traffic.rejected() == {"own perception": 1}


def test_a_tier_without_the_perception_that_it_needs_is_refused(camera_node, make_camera):
    for tier in ("features", "objects", "auto"):
        with pytest.raises(ConfigError, match="SURVEILNAV_CAMERA__PERCEPTION"):
            CameraService(camera_node, make_camera(), CameraSettings(tier=tier))


@pytest.mark.parametrize("budget", [0, -1, float("nan")])
def test_a_budget_of_nothing_is_refused(budget):
    with pytest.raises(ValueError, match="budget_kb_s"):
        CameraSettings(budget_kb_s=budget)


def test_a_small_budget_is_kept_and_nothing_is_lost(start):
    """Five views of some 650 B at 1 kB/s: the burst is 2 kB, so the last one waits for its turn."""
    service, slots = start(Looking(), views=range(5), tier="features", budget_kb_s=1.0)
    began_s, got = time.monotonic(), {}

    def received():
        service.step()
        for view, slot in slots.items():
            if (frame := slot.poll()) is not None:
                got[view] = len(frame.payload)
        return len(got) == 5

    until(received)
    took_s, total = time.monotonic() - began_s, sum(got.values())
    assert total > 2000, "the budget isn't what is tested here"
    assert total <= 2000 + 1000 * took_s + max(got.values())


def test_auto_sends_objects_first_and_features_when_nothing_waits(start, client):
    """Six views of 9 kB would take longer than the 14 kB of the burst and 35 kB in five seconds."""
    frames = listen(client, range(6))
    service, _ = start(Looking(), views=range(6), tier="auto", budget_kb_s=7.0)

    def settled():
        service.step()
        return {f.view for f in frames if f.tier == "features"} == set(range(6))

    until(settled)
    assert [f.tier for f in frames if f.view == 0] == ["objects", "features"]


@pytest.mark.parametrize("budget_kb_s", [0.3, 1.0])
def test_auto_with_a_tiny_budget_ends_with_features_too(start, client, budget_kb_s):
    """However long the features of a view take: they are sent once, and then nothing."""
    frames = listen(client, [3])
    service, _ = start(Looking(), tier="auto", budget_kb_s=budget_kb_s)

    def pay() -> bool:
        service.step()
        service._sender._bucket = TokenBucket.full(1000 * budget_kb_s, time.monotonic())
        return [f.tier for f in frames][-1:] == ["features"]

    until(pay)
    assert [f.tier for f in frames] == ["objects", "features"]
    for _ in range(5):
        assert not service.step()


def test_a_view_that_changes_often_keeps_no_other_from_being_sent(start, client):
    frames = listen(client, range(3))
    service, _ = start(Looking(), views=range(3), tier="jpeg+depth", budget_kb_s=0.001)
    for n in range(6):
        service.camera.versions[0] += 1
        until(service.step)
        until(lambda n=n: len(frames) == n + 1)
        service._sender._bucket = TokenBucket.full(1.0, time.monotonic())
    assert [f.view for f in frames][:4] == [0, 1, 2, 0]


def test_a_jpeg_that_is_wanted_whole_isnt_sent_again_and_again(start, client):
    service, _ = start(Looking(), tier="jpeg")
    service.step()
    client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="resend", views=[3], pictures=True), **PLACE)
    assert service.step()
    assert not service.step()


def test_who_is_paused_sends_nothing_more_of_what_was_due(start, client):
    """Paused while the second of five views is looked at."""
    frames, backend = listen(client, range(5)), Looking()
    service, _ = start(backend, views=range(5), tier="features")
    see = backend.perceive

    def pause_then(*args, **more):
        if len(backend.looks) == 1:
            service.paused = True
        return see(*args, **more)

    backend.perceive = pause_then
    service.step()
    assert not service.step()
    time.sleep(0.3)
    assert [f.view for f in frames] == [0]
    service.paused = False
    repeat_until(service.step, lambda: len(frames) == 6)


def test_what_the_budget_makes_wait_comes_in_the_order_that_is_wanted(start, client):
    """One frame empties the bucket of 2 B; then the last view of the order is waited for."""
    frames = listen(client, range(4))
    service, _ = start(Looking(), views=range(4), tier="features", budget_kb_s=0.001)
    client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="order", views=[2, 0]), **PLACE)
    for n in range(1, 5):
        until(service.step)
        until(lambda n=n: len(frames) == n)
        service._sender._bucket = service._sender._bucket.without(-10_000)  # the debt is paid
    assert [f.view for f in frames] == [2, 0, 1, 3]


def test_people_are_told_the_tier(start, client):
    start(Looking(), tier="auto")
    assert client.ask(CAMERA_INFO, **PLACE).message.tier == "auto"


class SlowLink:
    """A node's link whose kernel counts are the test's: nothing of what is sent arrives until ``arrives``."""

    def __init__(self, node) -> None:
        self.acknowledged, self.queued = 0, 10_000
        node.wire_bytes = lambda: WireBytes(0, 0, self.acknowledged, 100, 0.0, self.queued)

    def arrives(self) -> None:
        self.acknowledged += 1_000_000


def test_a_slow_link_gets_one_frame_at_a_time_and_those_that_wait_are_the_newest(start, client, camera_node):
    frames = listen(client, range(3))
    service, _ = start(Looking(), views=range(3), tier="jpeg+depth")
    link = SlowLink(camera_node)
    for n in range(3):
        assert service.step()
        assert not service.step()
        service.camera.versions[2] += 1  # view 2 waits longest
        until(lambda n=n: len(frames) == n + 1)
        link.arrives()
    assert [f.view for f in frames] == [0, 1, 2]
    report = camera_node.traffic_report()
    assert report.unsent == {"link": 2}, "two pictures of view 2 waited and were replaced; its last one was sent"
    assert report.tier_bytes["jpeg+depth"] == sum(r.n_bytes for r in report.rows if "/frame/" in r.key)


def test_what_is_asked_for_while_it_is_under_way_isnt_sent_twice(start, client, camera_node):
    frames = listen(client, [3])
    service, _ = start(Looking(), tier="jpeg+depth")
    link = SlowLink(camera_node)
    again = CameraRequest(stamp_ns=1, action="resend", views=[3])
    service.step()
    client.ask(CAMERA_REQUEST, again, **PLACE)
    assert not service.step()
    link.arrives()
    assert not service.step()
    client.ask(CAMERA_REQUEST, again, **PLACE)
    assert service.step()
    until(lambda: len(frames) == 2)


def test_what_got_lost_on_its_way_is_sent_to_who_asked_meanwhile(start, client, camera_node):
    frames = listen(client, [3])
    service, _ = start(Looking(), tier="jpeg+depth")
    link = SlowLink(camera_node)
    service.step()
    client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="resend", views=[3]), **PLACE)
    assert not service.step()
    link.queued = 0  # and nothing was acknowledged
    time.sleep(0.3)
    assert service.step()
    until(lambda: len(frames) == 2)


def test_pictures_are_sent_although_what_was_seen_is_under_way(start, client, camera_node):
    frames = listen(client, [3])
    service, _ = start(Looking(), tier="features")
    link = SlowLink(camera_node)
    service.step()
    client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="resend", views=[3], pictures=True), **PLACE)
    assert not service.step()
    link.arrives()
    assert service.step()
    assert [f.tier for f in until(lambda: len(frames) == 2 and frames)] == ["features", "jpeg+depth"]


def test_a_camera_that_was_idle_sends_at_once(start, client, camera_node):
    frames = listen(client, [3])
    service, _ = start(Looking(), tier="jpeg+depth")
    link = SlowLink(camera_node)
    service.step()
    link.arrives()
    for _ in range(20):  # the loop turns while nothing happens
        time.sleep(0.02)
        service.step()
    service.camera.versions[3] += 1
    service.step()
    until(lambda: len(frames) == 2)


def test_views_that_take_turns_on_a_slow_link_are_no_problem(start, client, camera_node, monkeypatch):
    monkeypatch.setattr("surveilnav.services.camera_node.view_sender._LONG_WAIT_S", 0.3)
    service, _ = start(Looking(), views=range(2), tier="jpeg+depth")
    link = SlowLink(camera_node)
    for _ in range(20):
        for view in range(2):
            service.camera.versions[view] += 1
        service.step()
        time.sleep(0.03)
        link.arrives()
    assert not camera_node.traffic_report().problems


def test_a_link_that_takes_too_little_gets_objects_and_people_are_told(start, client, camera_node, monkeypatch):
    frames = listen(client, range(4))
    service, _ = start(Looking(), views=range(4), tier="auto")
    link = SlowLink(camera_node)
    sender = service._sender
    sender._link = Link(rate_bytes_s=1000.0)  # four views of 9 kB would take it half a minute
    service.step()
    assert [f.tier for f in until(lambda: frames)] == ["objects"]
    monkeypatch.setattr("surveilnav.services.camera_node.view_sender._LONG_WAIT_S", 0.05)
    time.sleep(0.1)
    service.step()
    assert "its link is too slow" in camera_node.traffic_report().problems["link"]

    def all_sent() -> bool:
        link.arrives()
        service.step()
        return len({f.view for f in frames}) == 4

    until(all_sent)
    service.step()
    assert not camera_node.traffic_report().problems


def test_a_view_that_was_sent_after_somebody_asked_for_it_isnt_sent_again(start, client):
    """While views are looked at, which takes long, those that are missing are asked for."""
    frames, backend = listen(client, range(3)), Looking()
    service, _ = start(backend, views=range(3), tier="features")
    see = backend.perceive

    def ask_then(*args, **more):
        if not backend.looks:
            client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="resend", views=[0, 1, 2]), **PLACE)
        return see(*args, **more)

    backend.perceive = ask_then
    while service.step():
        pass
    client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="resend", views=[1]), **PLACE)
    service.step()
    until(lambda: len(frames) == 4)
    time.sleep(0.2)
    assert sorted((f.view, f.seq) for f in frames) == [(0, 1), (1, 1), (1, 2), (2, 1)], (
        "threads of the bus deliver in any order"
    )
