"""Who is there, on a real router."""

from __future__ import annotations

import subprocess
import sys
import threading
import time

import pytest
import zenoh

import surveilnav
from surveilnav.bus import BusSettings, Node, presence
from surveilnav.bus.router import free_port
from surveilnav.contract import ROUTER, VERSION
from surveilnav.errors import BusError
from tests.waiting import until


def test_presence_follows_life(make_node, bus):
    watcher = make_node("b", "b")
    assert watcher.alive("robot") == set()
    with Node("robot", "r7", bus):
        until(lambda: watcher.alive("robot") == {"r7"})
    until(lambda: watcher.alive("robot") == set())


def test_a_node_counts_its_routers(make_node):
    assert make_node("b", "b").routers() == 1


@pytest.fixture
def impatient(monkeypatch):
    monkeypatch.setattr(presence, "NAME_WAIT_S", 0.5)


def test_a_second_node_of_one_name_is_refused_by_name(impatient, make_node, bus):
    make_node("robot", "r7")
    with pytest.raises(BusError, match="a robot named 'r7' is on the bus already"), Node("robot", "r7", bus):
        pass
    with Node("robot", "r8", bus), Node("camera", "r7", bus):
        pass


def test_a_name_is_free_again_when_its_process_ends(bus):
    """The second waits for it, as after a crash whose connection the router hasn't missed yet."""
    first = Node("robot", "r7", bus)
    first.__enter__()
    timer = threading.Timer(1.0, lambda: first.__exit__(None, None, None))
    timer.start()
    began_s = time.monotonic()
    with Node("robot", "r7", bus):
        assert time.monotonic() - began_s > 0.8
    timer.join()


def test_of_several_that_start_at_once_one_stays(impatient, bus, monkeypatch):
    """All of them find the name free, which only happens if they look at the same moment."""
    found, looked = presence.Presence._instances, set()

    def free_at_first(self, name):
        others = found(self, name)
        if self in looked:
            return others
        looked.add(self)
        return set()

    monkeypatch.setattr(presence.Presence, "_instances", free_at_first)
    n, staying, gate, checked = 4, [], threading.Barrier(4), threading.Event()

    def start():
        gate.wait()
        try:
            with Node("robot", "r7", bus) as node:
                checked.wait(20)
                if not node.stopping.is_set():
                    staying.append(node)
        except BusError:
            pass

    threads = [threading.Thread(target=start) for _ in range(n)]
    for thread in threads:
        thread.start()
    time.sleep(2.0)  # longer than any waits for the name
    checked.set()
    for thread in threads:
        thread.join(20)
    assert len(staying) == 1


# --- releases ----------------------------------------------------------------------------------------------------------


@pytest.fixture
def other_router(bus):
    """What the router of another release would declare; another session may, as long as rules don't forbid it."""
    with zenoh.open(zenoh.Config.from_json5(bus.client_config())) as session:
        yield lambda contract: session.liveliness().declare_token(ROUTER.format(contract=contract, release="9.0.0"))


def test_a_node_that_speaks_another_contract_than_the_router_is_refused_by_name(other_router, bus):
    token = other_router(VERSION + 1)
    refusal = rf"is of release 9\.0\.0 and speaks contract {VERSION + 1}, but this camera is of release"
    with pytest.raises(BusError, match=refusal), Node("camera", "c1", bus):
        pass
    token.undeclare()
    with Node("camera", "c1", bus):
        pass


def test_a_node_ends_when_a_router_of_another_contract_takes_the_place_of_its_own(other_router, make_node, bus):
    old, watcher = make_node("camera", "c1"), make_node("gateway", "g")
    assert not old.stopping.is_set()
    _token = other_router(VERSION + 1)
    assert old.stopping.wait(5.0)
    assert watcher.stopping.wait(5.0)


def test_a_router_of_another_release_that_speaks_the_same_contract_is_fine(other_router, bus):
    _token = other_router(VERSION)
    with Node("camera", "c1", bus) as node:
        assert not node.stopping.wait(0.5)


def test_the_router_says_which_contract_it_speaks():
    """The real process."""
    port = free_port()
    command = [sys.executable, "-m", "surveilnav.bus.router", "--listen", f"tcp/127.0.0.1:{port}"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as router:
        try:
            assert router.stderr is not None
            assert "listening" in router.stderr.readline()
            settings = BusSettings(router=f"tcp/127.0.0.1:{port}")
            with zenoh.open(zenoh.Config.from_json5(settings.client_config())) as session:
                replies = session.liveliness().get(ROUTER.format(contract="*", release="*"), timeout=5.0)
                keys = [str(reply.ok.key_expr) for reply in replies if reply.ok]
            assert keys == [ROUTER.format(contract=VERSION, release=surveilnav.__version__)]
            with Node("camera", "c1", settings) as node:
                assert node.traffic_report().release == surveilnav.__version__
        finally:
            router.terminate()
