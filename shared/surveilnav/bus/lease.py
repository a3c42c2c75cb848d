"""Leases a slot to this process, such as a camera or a part of the building, because replicas of a container don't know which
one they are.

A slot is the name of a node, and a name belongs to one process (``presence``). A process without one takes a name that no
present node has; if another took it at the same moment, it looks again.
"""

from __future__ import annotations

import sys
import time
import uuid
import zlib
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager

from surveilnav.bus.node import Node
from surveilnav.bus.settings import BusSettings
from surveilnav.errors import NameTakenError

_RETRY_S = 0.3
#: So long a process keeps a name before it works under it: another that looked at the same moment may have taken it, too.
_SETTLE_S = 0.3
_WAIT_S = 2.0  # between two attempts of a process that waits for a slot to become free


@contextmanager
def lease_slot(
    kind: str, names: Sequence[str], settings: BusSettings, wait_s: float = 3.0
) -> Iterator[tuple[str, Node] | None]:
    """A free one of these names, and the node of this kind that has it until the block ends; None if none is free in time."""
    with ExitStack() as stack:
        yield _acquire(kind, names, settings, wait_s, stack)


@contextmanager
def take_slot(
    kind: str, list_names: Callable[[], Sequence[str]], settings: BusSettings, where: str
) -> Iterator[tuple[str, Node]]:
    """A free name and its node, until the block ends, however long it takes to get one.

    Args:
        kind: the kind of node.
        list_names: lists the names that there are; asked again while none is free.
        where: where they are listed, for people.
    """
    announced = False
    while True:
        names = list_names()
        with lease_slot(kind, names, settings) as leased:
            if leased is not None:
                yield leased
                return
        if not announced:
            print(f"{kind}: all {len(names)} of {where} are taken; waiting for one", file=sys.stderr)
            announced = True
        _touch_health_file(settings)
        time.sleep(_WAIT_S)


def choose_slot(names: Sequence[str], taken: Collection[str], process_id: str) -> str | None:
    """A name that nobody has, or None.

    Each process begins at a name that depends on its id, so that replicas that start together seldom collide.
    """
    if not names:
        return None
    start = zlib.crc32(process_id.encode()) % len(names)
    return next((name for name in (*names[start:], *names[:start]) if name not in taken), None)


def _acquire(
    kind: str, names: Sequence[str], settings: BusSettings, wait_s: float, stack: ExitStack
) -> tuple[str, Node] | None:
    """Takes a slot and leaves its node open in ``stack``."""
    process_id = uuid.uuid4().hex[:12]
    with Node(f"{kind}-candidate", process_id, settings, alive=False) as candidate:
        until_s, refused = time.monotonic() + wait_s, set[str]()
        while time.monotonic() < until_s:
            name = choose_slot(names, candidate.alive(kind) | refused, process_id)
            if name is None:
                refused.clear()  # who had it may have left it
                candidate.stopping.wait(_RETRY_S)
            elif holder := _node_of(kind, name, settings, stack):
                return name, holder
            else:
                refused.add(name)
    return None


def _node_of(kind: str, name: str, settings: BusSettings, stack: ExitStack) -> Node | None:
    """The node of this name, left open in ``stack``; None if another process has the name."""
    with ExitStack() as trial:
        try:
            holder = trial.enter_context(Node(kind, name, settings, waits_for_name=False))
        except NameTakenError:
            return None
        if holder.stopping.wait(_SETTLE_S):
            return None
        stack.enter_context(trial.pop_all())
        return holder


def _touch_health_file(settings: BusSettings) -> None:
    """Reports a spare replica, which waits for a slot to become free, as healthy."""
    if settings.health_file:
        settings.health_file.parent.mkdir(parents=True, exist_ok=True)
        settings.health_file.touch()
