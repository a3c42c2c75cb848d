"""What keeps the screen up to date: it outlives the gateway."""

from __future__ import annotations

import threading
from typing import Any, cast

import pytest

from surveilnav.cli.watching import feed as module
from surveilnav.cli.watching.feed import Feed
from surveilnav.client import Client, ServerEvent
from surveilnav.errors import GatewayError
from surveilnav.rest import Event, Mission, Traffic, examples
from tests.waiting import until

MISSION = Mission.model_validate(examples.MISSION)
TRAFFIC = Traffic(offered_bytes=0, delivered_bytes=0, wire_sent_bytes=None, nodes=[], cameras=[], robots=[])


class Gateway:
    """A gateway that can go away. ``streams``: what each connection tells; an error is raised."""

    def __init__(self, *streams: list[Any]) -> None:
        self.streams, self.asked = list(streams), list[str]()
        self.away = threading.Event()

    def events(self, last_id: str) -> Any:
        self.asked.append(last_id)
        if not self.streams:
            threading.Event().wait(30)
            raise RuntimeError("the client was closed")
        for told in self.streams.pop(0):
            if isinstance(told, Exception):
                raise told
            yield told

    def __getattr__(self, name: str) -> Any:
        def answer(*_: Any) -> Any:
            if self.away.is_set():
                raise GatewayError("no_gateway", "away")
            return {"traffic": TRAFFIC, "missions": [MISSION]}.get(name, [])

        return answer


@pytest.fixture(autouse=True)
def quick(monkeypatch):
    for name in ("_MOVING_S", "_REST_S", "_AGAIN_S"):
        monkeypatch.setattr(module, name, 0.01)


def test_a_stream_that_is_refused_later_goes_on_where_it_was():
    gateway = Gateway(
        [ServerEvent("7", "reset", Event()), GatewayError("no_gateway", "502")], [ServerEvent("8", "mission", Event())]
    )
    feed = Feed(cast("Client", gateway), reads=False)
    assert [cast("ServerEvent[Event]", feed.events.get(timeout=10)).id for _ in range(2)] == ["7", "8"]
    until(lambda: len(gateway.asked) >= 2)
    assert gateway.asked[:2] == ["", "7"]
    feed.close()


def test_a_gateway_that_was_never_there_is_a_mistake():
    feed = Feed(cast("Client", Gateway([GatewayError("no_gateway", "away")])), reads=False)
    assert isinstance(feed.events.get(timeout=10), GatewayError)
    feed.close()


def test_what_is_known_stays_while_the_gateway_is_away():
    gateway = Gateway()
    feed = Feed(cast("Client", gateway))
    until(lambda: feed.known.traffic is not None)
    gateway.away.set()
    until(lambda: feed.known.lost)
    since = feed.known.lost
    assert feed.known.missions == [MISSION]
    assert feed.known.lost == since
    gateway.away.clear()
    until(lambda: feed.known.lost is None)
    feed.close()
