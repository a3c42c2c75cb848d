"""Leases a slot to this process, such as a camera or a part of the building, because replicas of a container don't know which
one they are.

The process that has a slot answers queries on its key. A process without one asks which keys answer, takes a free slot and
asks again; if several took the same one, the smallest id keeps it. A holder that dies stops answering, so its slot is free
at once.
"""

from __future__ import annotations

import sys
import time
import uuid
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from surveilnav.bus.connection import Received
from surveilnav.bus.node import Node
from surveilnav.bus.queries import Answer
from surveilnav.bus.settings import BusSettings
from surveilnav.bus.slot_choice import choose_slot, keeps_slot
from surveilnav.bus.wire import clock_ns
from surveilnav.contract import Stream
from surveilnav.messages import Ack, SlotClaim

_ASK_TIMEOUT_S = 1.0
_RETRY_S = 0.5
#: How long a rival's claim may take to reach the router.
_CLAIM_S = 0.3
_WAIT_S = 2.0  # between two attempts of a process that waits for a slot to become free


@dataclass(frozen=True, slots=True)
class Slots:
    """Slots of one kind: ``stream`` is what their holders answer on, by ``kind``, which is the kind of their nodes, too."""

    stream: Stream
    kind: str

    @contextmanager
    def lease(
        self, names: Sequence[str], settings: BusSettings, wait_s: float = 3.0
    ) -> Iterator[tuple[str, Node] | None]:
        """A free one of these slots, and the node that holds it until the block ends; None if none is free in time."""
        with ExitStack() as stack:
            yield self._acquire(names, settings, wait_s, stack)

    @contextmanager
    def take(
        self, list_names: Callable[[], Sequence[str]], settings: BusSettings, where: str
    ) -> Iterator[tuple[str, Node]]:
        """A free slot and its node, until the block ends, however long it takes to get one.

        Args:
            list_names: lists the slots that there are; asked again while none is free.
            where: where they are listed, for people.
        """
        announced = False
        while True:
            names = list_names()
            with self.lease(names, settings) as leased:
                if leased is not None:
                    yield leased
                    return
            if not announced:
                print(f"{self.kind}: all {len(names)} of {where} are taken; waiting for one", file=sys.stderr)
                announced = True
            _touch_health_file(settings)
            time.sleep(_WAIT_S)

    def _acquire(
        self, names: Sequence[str], settings: BusSettings, wait_s: float, stack: ExitStack
    ) -> tuple[str, Node] | None:
        """Takes a slot and leaves its node open in ``stack``."""
        me = uuid.uuid4().hex[:12]
        with Node(f"{self.kind}-candidate", me, settings, alive=False) as candidate:
            stop_ns = clock_ns() + int(wait_s * 1e9)
            while clock_ns() < stop_ns:
                taken = {answer.ids[self.kind] for answer in self._ask_holders(candidate, me)}
                name = choose_slot(names, taken, me)
                if name is None:
                    candidate.stopping.wait(_RETRY_S)
                    continue
                with ExitStack() as trial:
                    holder = trial.enter_context(Node(self.kind, name, settings))
                    if self._claim(candidate, holder, name, me):
                        stack.enter_context(trial.pop_all())
                        return name, holder
        return None

    def _claim(self, candidate: Node, holder: Node, name: str, me: str) -> bool:
        """Has ``holder`` answer for a slot, and returns whether it may keep it."""
        claimed_by = [me]
        ids: dict[str, Any] = {self.kind: name}
        holder.serve(self.stream, lambda _: Answer(Ack(stamp_ns=clock_ns(), message=claimed_by[0])), **ids)
        candidate.stopping.wait(_CLAIM_S)
        rivals = {a.message.message for a in self._ask_holders(candidate, me, **ids)}
        keeps = keeps_slot(me, rivals - {me})
        if keeps:
            claimed_by[0] = ""  # the smallest id of all: every later claim yields to it
        return keeps

    def _ask_holders(self, candidate: Node, me: str, **slot: Any) -> list[Received[Ack]]:
        """The answers of those who have the slot, or any slot if none is given."""
        claim = SlotClaim(stamp_ns=clock_ns(), node=me)
        return candidate.ask_all(self.stream, claim, timeout_s=_ASK_TIMEOUT_S, **slot)


def _touch_health_file(settings: BusSettings) -> None:
    """Reports a spare replica, which waits for a slot to become free, as healthy."""
    if settings.health_file:
        settings.health_file.parent.mkdir(parents=True, exist_ok=True)
        settings.health_file.touch()
