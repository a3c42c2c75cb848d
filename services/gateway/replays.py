"""A recording that is shown again in the place of a building: where it is, and having it go elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from surveilnav import contract
from surveilnav.bus import Received, clock_ns
from surveilnav.messages import ReplayControl, ReplayStatus
from surveilnav.services.gateway.asking import ask
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import Replay, ReplayChange
from surveilnav.services.gateway.state import BuildingState


class Remembers(Protocol):
    """What knows of a building, and can begin anew."""

    def clear(self) -> None: ...


class Replays:
    """The replay, if there is one. When it is taken to another moment, ``all_who_remember`` begin anew: they may know its
    future."""

    def __init__(self, state: BuildingState, all_who_remember: Sequence[Remembers]) -> None:
        self._state, self._node, self._all = state, state.node, all_who_remember
        self._jumps: dict[str, int] = {}
        state.replays.on_message = self._on_status

    def shown(self) -> Replay | None:
        """The replay; None: this is a building."""
        row = self._newest()
        return None if row is None else Replay.from_status(row.message, row.received_ns, self._state.replays.old(row))

    def one(self) -> Replay:
        """The replay; 404 if this is a building."""
        if (found := self.shown()) is None:
            raise _no_replay()
        return found

    def change(self, wanted: ReplayChange) -> Replay:
        """Has it play, stand still, go to a moment, or change its speed."""
        if (shown := self._newest()) is None:
            raise _no_replay()
        control = ReplayControl(stamp_ns=clock_ns(), **wanted.model_dump())
        row = ask(self._node, "replay", contract.REPLAY_CONTROL, control, player=shown.ids["player"])
        return Replay.from_status(row.message, row.received_ns, stale=False)

    def _newest(self) -> Received[ReplayStatus] | None:
        """What the player that is there told last."""
        there = self._node.alive("replay")
        return next((row for id, row in self._state.replays.newest("player").items() if id in there), None)

    def _on_status(self, row: Received[ReplayStatus]) -> None:
        jumps, player = row.message.jumps, row.ids["player"]
        if self._jumps.get(player, jumps) != jumps:
            for one in self._all:
                one.clear()
        self._jumps[player] = jumps


def _no_replay() -> Problem:
    detail = "this is no recording: `surveilnav replay FILE` shows one, on a gateway of its own"
    return Problem(404, "no_replay", detail)
