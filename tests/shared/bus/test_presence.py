"""Who is there, on a real router."""

from __future__ import annotations

import threading
import time

import pytest

from surveilnav.bus import Node, presence
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
