"""``surveilnav find`` on a gateway that is made up."""

from __future__ import annotations

import io
from typing import Any

import pytest
from rich.console import Console

from cli import remote


@pytest.mark.parametrize(
    ("typed", "target", "said"),
    [
        ("Fernseher", "tv", "Fernseher: perception calls it tv"), ("TV", "tv", ""), ("Sofa", "couch", ""), ("bed", "bed", ""),
    ],
)  # fmt: skip
def test_it_says_what_perception_calls_a_target(
    monkeypatch: pytest.MonkeyPatch, typed: str, target: str, said: str
) -> None:
    asked: list[Any] = []

    def call(url: str, method: str, path: str, body: Any = None) -> dict[str, Any]:
        asked.append(body)
        return {
            "id": "m", "target": target, "state": "done", "phase": "finished", "step": 1, "max_steps": 5, "found": True,
            "message": "there it is",
        }  # fmt: skip

    monkeypatch.setattr(remote, "call", call)
    printed = io.StringIO()
    mission = remote.follow_mission("http://x", typed, "", 5, Console(file=printed, width=100))
    assert mission["found"]
    assert asked[0] == {"target": typed, "max_steps": 5}
    assert said in printed.getvalue()
    assert ("perception calls it" in printed.getvalue()) == bool(said)
