"""What a replay tells of itself when it is taken elsewhere: it never says so before it begins anew."""

from __future__ import annotations

from typing import Any

import pytest

from cli.replay.clock import ReplayClock
from cli.replay.control import ReplayControls
from surveilnav import contract
from surveilnav.bus import Refused, Request
from surveilnav.messages import ReplayControl


class DeafNode:
    """In the place of a node: keeps what serves each stream."""

    id = "replay"

    def __init__(self) -> None:
        self.serving: dict[contract.Stream, Any] = {}

    def publisher(self, stream: contract.Stream, **ids: str) -> None:
        return None

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


def test_a_jump_counts_when_it_is_taken_not_when_it_is_wanted(node: DeafNode, controls: ReplayControls) -> None:
    node.control(at_s=80.0)
    node.control(at_s=20.0, playing=False)
    assert controls.status().jumps == 0  # whoever hears of one forgets; what is told until it is taken lies before it
    assert controls.take_jump() == 20.0
    assert controls.take_jump() is None
    assert (controls.status().jumps, controls.status().at_s) == (1, 20.0)


@pytest.mark.parametrize("wanted", [{"at_s": float("nan")}, {"speed": 0.0}, {"speed": 1e9}])
def test_what_can_t_be_is_refused(node: DeafNode, controls: ReplayControls, wanted: dict[str, float]) -> None:
    with pytest.raises(Refused):
        node.control(**wanted)
    assert controls.take_jump() is None
