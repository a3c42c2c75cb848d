"""``surveilnav find`` on a gateway that is made up."""

from __future__ import annotations

import io
from typing import Any, cast

import pytest
from rich.console import Console

from cli import remote
from surveilnav.client import Client


@pytest.mark.parametrize(
    ("typed", "target", "said"),
    [
        ("Fernseher", "tv", "Fernseher: perception calls it tv"), ("TV", "tv", ""), ("Sofa", "couch", ""), ("bed", "bed", ""),
    ],
)  # fmt: skip
def test_it_says_what_perception_calls_a_target(typed: str, target: str, said: str) -> None:
    class Gateway:
        def submit(self, *asked: Any, queue: bool) -> dict[str, Any]:
            assert (asked, queue) == ((typed, None, 5), False)
            return self.mission("m")

        def mission(self, id: str) -> dict[str, Any]:
            return {
                "id": id, "target": target, "state": "done", "phase": "finished", "step": 1, "max_steps": 5, "found": True,
                "message": "there it is",
            }  # fmt: skip

    printed = io.StringIO()
    mission = remote.follow_mission(cast("Client", Gateway()), typed, "", 5, Console(file=printed, width=100))
    assert mission.get("found")
    assert said in printed.getvalue()
    assert ("perception calls it" in printed.getvalue()) == bool(said)
