"""A reader that doesn't read, on a real router of its own process: nobody else notices, and nothing that matters is lost."""

from __future__ import annotations

import json
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator

import pytest
import zenoh

from surveilnav.bus import Answer, BusSettings, Node, Refused, connection
from surveilnav.bus.connection import CONGESTION, PRIORITY, encoding_of
from surveilnav.bus.router import free_port
from surveilnav.bus.settings import MAX_MESSAGE_BYTES, router_config
from surveilnav.bus.wire import encode
from surveilnav.contract import MAP_LAYER, ROBOT_STATUS, STREAMS
from surveilnav.errors import BusError
from surveilnav.geometry import Grid
from surveilnav.messages import LayerHeader, Truth
from surveilnav.services.fusion.core import FusionConfig
from tests.bulk_stream import BULK
from tests.waiting import repeat_until, until, until_heard

#: Takes frames through small buffers, says so, and waits to be stopped.
READER = """
import sys, time, zenoh
with zenoh.open(zenoh.Config.from_json5(sys.argv[1])) as session:
    heard = session.declare_subscriber(sys.argv[2])
    heard.recv()
    print("reads", flush=True)
    while True:
        heard.recv()
"""
#: Asks for an answer four times at once, again and again, through small buffers, and waits to be stopped.
ASKER = """
import sys, threading, zenoh
with zenoh.open(zenoh.Config.from_json5(sys.argv[1])) as session:
    def ask():
        options = dict(priority=eval("zenoh." + sys.argv[3]), congestion_control=eval("zenoh." + sys.argv[4]))
        while True:
            for reply in session.get(sys.argv[2], timeout=5.0, **options):
                pass
    for _ in range(4):
        threading.Thread(target=ask, daemon=True).start()
    for reply in session.get(sys.argv[2], timeout=5.0):
        print("asks", flush=True)
    threading.Event().wait()
"""


@pytest.fixture
def alone() -> Iterator[BusSettings]:
    """The router as it is run: a process with its own threads."""
    bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}", building="test", connect_timeout_s=20)
    router = subprocess.Popen(
        [sys.executable, "-m", "surveilnav.bus.router", "--listen", bus.router], stderr=subprocess.DEVNULL
    )
    yield bus
    router.terminate()
    router.wait()


@pytest.fixture
def reader(alone: BusSettings) -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """``reader(key)``: the process of somebody who takes everything on a key, or does what ``program`` says."""
    started = []

    def start(key: str, program: str = READER, *arguments: str) -> subprocess.Popen[str]:
        config = alone.client_config().replace(alone.router, f"{alone.router}#so_rcvbuf=65536")
        command = [sys.executable, "-c", program, config, key, *arguments]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()


def test_a_frozen_reader_silences_nobody(alone, reader, truth, status):
    with Node("a", "a", alone, alive=False) as sender, Node("b", "b", alone, alive=False) as healthy:
        frames, states = sender.publisher(BULK, source="robot-r1", view=0), sender.publisher(ROBOT_STATUS, robot="r1")
        came, told = [], []
        healthy.subscribe(BULK, lambda received: came.append(received.message.seq), source="robot-r1", view=0)
        healthy.subscribe(ROBOT_STATUS, lambda received: told.append(received.message.seq), robot="r1")
        until(lambda: frames.matched and states.matched)
        frozen = reader(frames.key)
        repeat_until(
            lambda: frames.put(truth(0), b"x"), lambda: select.select([frozen.stdout], [], [], 0.05)[0], "no reader"
        )
        frozen.send_signal(signal.SIGSTOP)
        for seq in range(1, 61):  # three seconds: its link fills, and the router closes it after two
            frames.put(truth(seq), bytes(1_000_000))
            states.put(status(seq))
            # With BLOCK, or with one thread to send, this was silent for five seconds.
            until(lambda seq=seq: seq in came, f"frame {seq} never came", timeout_s=2.0)
            time.sleep(0.05)
        until(lambda: told == list(range(1, 61)))


def test_a_frozen_reader_of_maps_silences_nobody(alone, reader, status):
    with Node("a", "a", alone, alive=False) as fusion, Node("b", "b", alone, alive=False) as healthy:
        fusion.serve(MAP_LAYER, lambda _: Answer(layer(), bytes(4_000_000)), workers=3)
        states, told = fusion.publisher(ROBOT_STATUS, robot="r1"), []
        healthy.subscribe(ROBOT_STATUS, lambda received: told.append(received.message.seq), robot="r1")
        until(lambda: states.matched)
        map_now = lambda: healthy.ask(MAP_LAYER, floor="0", layer="cloud", timeout_s=2.0)  # noqa: E731
        until_heard(map_now)
        sent = (str(PRIORITY[MAP_LAYER.priority]), str(CONGESTION[MAP_LAYER.when_full]))
        frozen = reader(healthy.key(MAP_LAYER, floor="0", layer="cloud"), ASKER, *sent)
        assert frozen.stdout.readline() == "asks\n"
        frozen.send_signal(signal.SIGSTOP)  # with four answers on their way
        for seq in range(1, 31):  # three seconds: the router closes its link after two
            states.put(status(seq))
            # With BLOCK, both were silent for five seconds.
            map_now()
            until(lambda seq=seq: seq in told, f"state {seq} never came", timeout_s=2.0)
            time.sleep(0.1)
        assert told == list(range(1, 31))


def test_what_the_router_would_drop_is_refused_by_its_sender(make_node, truth, monkeypatch):
    monkeypatch.setattr(connection, "MAX_MESSAGE_BYTES", 1000)
    sender, asker = make_node("a", "a"), make_node("b", "b")
    with pytest.raises(BusError, match=r"up to 0\.00\d+ MiB, got .* for surveilnav/1/test/truth/robot-r1/0"):
        sender.publisher(BULK, source="robot-r1", view=0).put(truth(0), bytes(1000))
    sender.serve(MAP_LAYER, lambda _: Answer(layer(), bytes(1000)), floor="0", layer="cloud")
    with pytest.raises(Refused, match="a message may have up to"):
        until_heard(lambda: asker.ask(MAP_LAYER, floor="0", layer="cloud", timeout_s=5.0))


def layer() -> LayerHeader:
    grid = Grid(0.0, 0.0, 0.05, 1, 1)
    return LayerHeader(stamp_ns=1, floor="0", layer="cloud", revision=1, grid=grid, dtype="float32", shape=(0, 6))


def test_the_largest_message_passes_the_router_and_a_larger_one_of_a_stranger_does_not(make_node, truth, stranger):
    sender, receiver = make_node("a", "a"), make_node("b", "b")
    publisher, came = sender.publisher(BULK, source="robot-r1", view=0), []
    receiver.subscribe(BULK, lambda got: came.append((got.message.seq, len(got.payload))), source="robot-r1", view=0)
    until(lambda: publisher.matched)
    most = MAX_MESSAGE_BYTES - len(encode(truth(0)))
    publisher.put(truth(0), bytes(most))
    until(lambda: came)
    for seq, n_bytes in ((1, MAX_MESSAGE_BYTES + 2**17), (2, 5)):
        stranger.put(
            publisher.key,
            bytes(n_bytes),
            attachment=encode(truth(seq)),
            encoding=encoding_of(Truth),
            congestion_control=zenoh.CongestionControl.BLOCK,
            priority=zenoh.Priority.DATA_LOW,
        )
    until(lambda: len(came) > 1)
    assert came == [(0, most), (2, 5)]


def test_every_message_of_a_full_map_is_small_enough():
    """Uncompressed: what zstd can't make smaller it makes 0.4 % larger."""
    config = FusionConfig().map
    cells = (config.max_extent_m / config.resolution_m) ** 2
    floor_maps = cells * (1 + 1 + 1 + 4)  # occupancy, explored, frontier, value
    assert 1.01 * max(config.max_voxels * 24, floor_maps) < MAX_MESSAGE_BYTES


def test_only_what_is_put_or_asked_for_again_may_be_left_out():
    left_out = {s.name for s in STREAMS if s.when_full == "leave out"}
    assert left_out == {
        "camera_frame",
        "robot_observation",
        "truth",
        "floor_maps",
        "map_layer",
        "view_picture",
        "view_log",
        "map_snapshot",
        "recording_read",
    }
    questions = [s for s in STREAMS if s.when_full == "leave out" and s.kind != "put"]
    assert all(not s.allows_wildcard for s in questions), (
        "one lost answer of many isn't missed, and so not asked for again"
    )
    commands = {s.name for s in questions if s.request is not None} - {
        "recording_read"
    }  # its request names a stretch to read
    assert not commands, "what is asked again must change nothing"


@pytest.mark.parametrize(
    "made", [router_config("tcp/127.0.0.1:1"), BusSettings().client_config()], ids=["router", "client"]
)
def test_zenoh_takes_what_we_say_of_full_links(made):
    """Zenoh leaves out in silence what it doesn't know."""
    said = zenoh.Config.from_json5(made)
    queue = json.loads(said.get_json("transport/link/tx/queue/congestion_control"))
    assert queue["drop"]["wait_before_drop"] >= 50_000, "a burst of frames takes as long on a healthy link"
    assert queue["block"]["wait_before_close"] == 5_000_000, "a frame has so long to pass a slow link"
    assert json.loads(said.get_json("transport/link/tx/keep_alive")) == (20 if "listen" in json.loads(made) else 4)
    assert json.loads(said.get_json("transport/link/rx/max_message_size")) < 2**27
    unicast = json.loads(said.get_json("transport/unicast"))
    assert unicast["max_sessions"] >= 10_000, "Zenoh's own limit is 1,000, so the thousandth camera waits for ever"
    assert unicast["accept_pending"] >= 1_000, "all of them come back at once when the router restarts"
