"""``surveilnav find`` on a gateway that is made up."""

from __future__ import annotations

import io
from typing import Any, cast

import pytest
from rich.console import Console

from surveilnav.cli import following
from surveilnav.client import Client
from surveilnav.errors import GatewayError
from surveilnav.rest import Mission, examples


@pytest.mark.parametrize(
    ("typed", "target", "said"),
    [
        ("Fernseher", "tv", "Fernseher: perception calls it tv"),
        ("TV", "tv", ""),
        ("Sofa", "couch", ""),
        ("bed", "bed", ""),
    ],
)
def test_it_says_what_perception_calls_a_target(typed: str, target: str, said: str) -> None:
    class Gateway:
        def submit(self, *asked: Any, queue: bool) -> Mission:
            assert (asked, queue) == ((typed, None, 5), False)
            return self.mission("m")

        def mission(self, id: str) -> Mission:
            found = {
                "id": id,
                "target": target,
                "state": "done",
                "phase": "finished",
                "step": 1,
                "max_steps": 5,
                "found": True,
            }
            return Mission.model_validate({**examples.MISSION, **found, "message": "there it is"})

    printed = io.StringIO()
    mission = following.follow_mission(cast("Client", Gateway()), typed, "", 5, Console(file=printed, width=100))
    assert mission.found
    assert said in printed.getvalue()
    assert ("perception calls it" in printed.getvalue()) == bool(said)


class Away:
    """A gateway that is started anew while a mission runs: it is away for so many questions."""

    def __init__(self, times: int, name: str = "no_gateway") -> None:
        self.times, self.name = times, name

    def submit(self, *asked: Any, queue: bool) -> Mission:
        return Mission.model_validate(examples.MISSION)

    def mission(self, id: str) -> Mission:
        if self.times:
            self.times -= 1
            raise GatewayError(self.name, "away")
        return Mission.model_validate({**examples.MISSION, "state": "done", "found": True})


@pytest.fixture
def quick(monkeypatch):
    """Time passes by waiting alone."""
    now = [0.0]
    monkeypatch.setattr(following.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(following.time, "sleep", lambda s: now.__setitem__(0, now[0] + s))


def followed(gateway: Away) -> Any:
    console = Console(file=io.StringIO(), width=80)
    return following.follow_mission(cast("Client", gateway), "potted plant", "", 5, console)


def test_a_gateway_that_comes_back_is_waited_for(quick):
    assert followed(Away(20)).found


@pytest.mark.parametrize(("times", "name"), [(200, "no_gateway"), (1, "unknown_mission")])
def test_one_that_stays_away_or_refuses_is_told_of(quick, times, name):
    with pytest.raises(GatewayError, match="away"):
        followed(Away(times, name))
