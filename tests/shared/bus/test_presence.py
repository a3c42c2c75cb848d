"""Who is there, on a real router."""

from __future__ import annotations

from surveilnav.bus import Node
from tests.waiting import until


def test_presence_follows_life(make_node, bus):
    watcher = make_node("b", "b")
    assert watcher.alive("robot") == set()
    with Node("robot", "r7", bus):
        until(lambda: watcher.alive("robot") == {"r7"})
    until(lambda: watcher.alive("robot") == set())


def test_a_node_counts_its_routers(make_node):
    assert make_node("b", "b").routers() == 1
