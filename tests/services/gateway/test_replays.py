"""A recording in the place of a building: shown, taken elsewhere, and what is forgotten then."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import msgspec
import pytest

from surveilnav import contract
from surveilnav import messages as m
from surveilnav.bus import Answer, Node, Request, clock_ns
from surveilnav.client import Client
from tests.waiting import repeat_until, until


class FakePlayer:
    """Says what it was told last."""

    def __init__(self, node: Node) -> None:
        self.controls: list[m.ReplayControl] = []
        self._status = m.ReplayStatus(
            stamp_ns=clock_ns(),
            player="replay",
            mission="m1",
            target="tv",
            began_ns=10**18,
            at_s=3.0,
            duration_s=60.0,
            speed=1.0,
            playing=True,
            jumps=0,
        )
        self._publisher = node.publisher(contract.REPLAY, player="replay")
        node.serve(contract.REPLAY, lambda _: Answer(self._status), player="replay")
        node.serve(contract.REPLAY_CONTROL, self._on_control, player="replay")

    def put(self, **more: object) -> None:
        self._status = msgspec.structs.replace(self._status, stamp_ns=clock_ns(), **more)
        self._publisher.put(self._status)

    def _on_control(self, request: Request) -> Answer:
        self.controls.append(request.message)
        self.put(at_s=request.message.at_s or 0.0, jumps=self._status.jumps + 1)
        return Answer(self._status)


@pytest.fixture
def player(building, client: httpx.Client) -> Iterator[FakePlayer]:
    with Node("replay", "replay", building.settings) as node:
        player = FakePlayer(node)
        repeat_until(player.put, lambda: client.get("/api/v1/replay").status_code == 200)
        yield player
    until(lambda: client.get("/api/v1/replay").status_code == 404)


def test_a_building_is_no_replay(client: httpx.Client) -> None:
    for answer in (client.get("/api/v1/replay"), client.patch("/api/v1/replay", json={"playing": False})):
        assert (answer.status_code, answer.json()["type"].rpartition(":")[2]) == (404, "no_replay")
        assert "surveilnav replay FILE" in answer.json()["detail"]


def test_it_says_where_it_is_and_goes_elsewhere(client: httpx.Client, player: FakePlayer) -> None:
    found = client.get("/api/v1/replay").json()
    assert (found["mission"], found["at_s"], found["duration_s"], found["stale"]) == ("m1", 3.0, 60.0, False)
    assert found["began"].startswith("2001-09-09")
    with Client(str(client.base_url)) as gateway:
        assert gateway.change_replay(at_s=12.5).at_s == 12.5
        until(lambda: gateway.replay().jumps == 1)
    (control,) = player.controls
    assert (control.at_s, control.speed, control.playing) == (12.5, None, None)


@pytest.mark.parametrize(
    "wanted", [{"at_s": -1}, {"at_s": "NaN"}, {"speed": 0}, {"speed": 1e9}, {"playing": "maybe"}, {"when": 3}]
)
def test_what_makes_no_sense_is_refused(client: httpx.Client, player: FakePlayer, wanted: dict[str, object]) -> None:
    assert client.patch("/api/v1/replay", json=wanted).status_code == 422
    assert not player.controls


def test_after_a_jump_an_older_state_is_believed(client: httpx.Client, building, player: FakePlayer) -> None:
    """Without one it isn't: what is older came late."""
    mission = client.post("/api/v1/missions", json={"target": "tv"}).json()["id"]

    def shown() -> str:
        return str(client.get(f"/api/v1/missions/{mission}").json()["state"])

    def put(state: str, stamp_ns: int) -> None:
        building.missions[mission] = msgspec.structs.replace(building.missions[mission], state=state, stamp_ns=stamp_ns)
        building.put_status(building.missions[mission])

    now = clock_ns()
    put("done", now)
    until(lambda: shown() == "done")
    player.put(jumps=7)
    until(lambda: client.get("/api/v1/replay").json()["jumps"] == 7)
    put("active", now - 10**9)
    until(lambda: shown() == "active")
