"""What a replay tells of itself when it is taken elsewhere: it never says so before it begins anew."""

from __future__ import annotations

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from surveilnav import contract
from surveilnav.bus import Refused, Request
from surveilnav.cli.replay.clock import ReplayClock
from surveilnav.cli.replay.control import ReplayControls
from surveilnav.cli.replay.play import _Playing
from surveilnav.messages import ReplayControl, ReplayStatus


class DeafNode:
    """In the place of a node: keeps what serves each stream."""

    id = "replay"

    def __init__(self) -> None:
        self.serving: dict[contract.Stream, Any] = {}
        self.put: list[ReplayStatus] = []

    def publisher(self, stream: contract.Stream, **ids: str) -> Any:
        return SimpleNamespace(put=self.put.append)

    def serve(self, stream: contract.Stream, answer: Any, **ids: str) -> None:
        self.serving[stream] = answer

    def control(self, **wanted: Any) -> None:
        request = Request({"player": "replay"}, {}, ReplayControl(stamp_ns=1, **wanted), b"", 1)
        self.serving[contract.REPLAY_CONTROL](request)


@pytest.fixture
def node() -> DeafNode:
    return DeafNode()


@pytest.fixture
def controls(node: DeafNode) -> ReplayControls:
    return ReplayControls(node, ReplayClock(100.0), "m1", "bed", 0)  # type: ignore[arg-type]


def test_a_jump_counts_when_the_player_begins_anew_not_when_it_is_wanted(
    node: DeafNode, controls: ReplayControls
) -> None:
    node.control(at_s=80.0)
    node.control(at_s=20.0, playing=False)
    assert controls.take_jump() == 20.0
    assert controls.take_jump() is None
    assert controls.status().jumps == 0  # whoever hears of one forgets, and must not be told of the future afterwards
    controls.begin_anew()
    assert (controls.status().jumps, controls.status().at_s) == (1, 20.0)
    assert [status.jumps for status in node.put] == [1]


class Recorder:
    """In the place of a player: keeps what it is told to do, in its order."""

    def __init__(self) -> None:
        self.did: list[str] = []

    def __getattr__(self, name: str) -> Any:
        return lambda *args, **more: self.did.append(name)


@pytest.mark.parametrize("back", [True, False])
def test_who_is_taken_elsewhere_forgets_before_it_says_so(monkeypatch: pytest.MonkeyPatch, back: bool) -> None:
    monkeypatch.setattr("surveilnav.cli.replay.play.read_recording", lambda path: iter(()))
    log: Any = Recorder()
    playing = _Playing(log, log, Path("x"), 0)
    playing._told_s = 50.0
    playing._go_to(20.0 if back else 80.0, threading.Event())
    assert log.did == [*(["forget"] if back else []), "begin_anew", "tell_again"]


@pytest.mark.parametrize("wanted", [{"at_s": float("nan")}, {"speed": 0.0}, {"speed": 1e9}])
def test_what_can_t_be_is_refused(node: DeafNode, controls: ReplayControls, wanted: dict[str, float]) -> None:
    with pytest.raises(Refused):
        node.control(**wanted)
    assert controls.take_jump() is None
