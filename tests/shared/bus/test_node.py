"""A node's life on a real router: health, a router that is missing, one that returns."""

from __future__ import annotations

import threading
import time

import pytest

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.router import free_port, open_router
from surveilnav.contract import ROBOT_STATUS, TRAFFIC
from surveilnav.errors import BusError
from tests.waiting import until, until_heard


def test_a_loop_that_hangs_is_not_healthy(bus, tmp_path, monkeypatch):
    monkeypatch.setattr("surveilnav.bus.node._STALLED_S", 0.3)
    hang, goes_on = threading.Event(), threading.Event()
    settings = bus.model_copy(update={"health_file": tmp_path / "healthy"})
    with Node("a", "a", settings) as node:
        loop = threading.Thread(target=node.run, args=(lambda: hang.is_set() and goes_on.wait(10),))
        loop.start()
        until(settings.health_file.exists)
        assert node.healthy()
        hang.set()
        until(lambda: not node.healthy())
        goes_on.set()
        node.stop()
        loop.join()


def test_no_router_and_a_taken_port_are_told_apart():
    port = free_port()
    with (
        pytest.raises(BusError, match=f"no router answers at tcp/127.0.0.1:{port}"),
        Node("a", "a", BusSettings(router=f"tcp/127.0.0.1:{port}", connect_timeout_s=0.5)),
    ):
        pass
    with open_router(f"tcp/127.0.0.1:{port}"), pytest.raises(BusError, match=f"port {port} .* is taken"):
        open_router(f"tcp/127.0.0.1:{port}")


def test_a_router_that_returns_is_found_again(tmp_path, status):
    port = free_port()
    settings = BusSettings(router=f"tcp/127.0.0.1:{port}", connect_timeout_s=5)
    router = open_router(f"tcp/127.0.0.1:{port}")
    with Node("a", "a", settings) as sender, Node("b", "b", settings) as receiver:
        table = receiver.table(ROBOT_STATUS)
        publisher = sender.publisher(ROBOT_STATUS, robot="r1")
        router.close()
        time.sleep(0.5)
        with open_router(f"tcp/127.0.0.1:{port}"):

            def arrives():
                publisher.put(status(5))
                return table.get(robot="r1")

            until(arrives, timeout_s=15)


def test_a_problem_is_told_while_it_lasts(make_node):
    node, client = make_node("fusion", "f"), make_node("cli", "c", alive=False)
    problems = lambda: client.ask(TRAFFIC, node="fusion-f").message.problems  # noqa: E731
    assert until_heard(problems) == {}
    node.report_problem("store", "the disk is full" + "!" * 1000)
    node.report_problem("other", "")
    assert list(problems()) == ["store"]
    assert len(problems()["store"]) == 500
    node.report_problem("store", "")
    assert problems() == {}
