"""Leases a camera to this process, because replicas of a container don't know which one they are.

The process that has a camera answers queries on its key. A process without one asks which keys answer, takes a free camera and
asks again; if several took the same one, the smallest id keeps it. A holder that dies stops answering, so its camera is free
at once.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any

from surveilnav.bus import Answer, BusSettings, Node, Received, clock_ns
from surveilnav.contract import CAMERA_SLOT
from surveilnav.messages import Ack, SlotClaim
from surveilnav.services.camera_node.core.lease import choose_camera, keeps_camera

_ASK_TIMEOUT_S = 1.0
_RETRY_S = 0.5
#: How long a rival's claim may take to reach the router.
_CLAIM_S = 0.3


@contextmanager
def lease(names: Sequence[str], settings: BusSettings, wait_s: float = 3.0) -> Iterator[tuple[str, Node] | None]:
    """A free one of these cameras, and the node that holds it until the block ends; None if none is free in time."""
    with ExitStack() as stack:
        yield _acquire(names, settings, wait_s, stack)


def _acquire(names: Sequence[str], settings: BusSettings, wait_s: float, stack: ExitStack) -> tuple[str, Node] | None:
    """Takes a camera and leaves its node open in ``stack``."""
    me = uuid.uuid4().hex[:12]
    with Node("camera-candidate", me, settings, alive=False) as candidate:
        stop_ns = clock_ns() + int(wait_s * 1e9)
        while clock_ns() < stop_ns:
            taken = {answer.ids["camera"] for answer in _ask_holders(candidate, me)}
            name = choose_camera(names, taken, me)
            if name is None:
                candidate.stopping.wait(_RETRY_S)
                continue
            with ExitStack() as trial:
                holder = trial.enter_context(Node("camera", name, settings))
                if _claim(candidate, holder, name, me):
                    stack.enter_context(trial.pop_all())
                    return name, holder
    return None


def _claim(candidate: Node, holder: Node, name: str, me: str) -> bool:
    """Has ``holder`` answer for a camera, and returns whether it may keep it."""
    claimed_by = [me]
    holder.serve(CAMERA_SLOT, lambda _: Answer(Ack(stamp_ns=clock_ns(), message=claimed_by[0])), camera=name)
    candidate.stopping.wait(_CLAIM_S)
    rivals = {a.message.message for a in _ask_holders(candidate, me, camera=name)}
    keeps = keeps_camera(me, rivals - {me})
    if keeps:
        claimed_by[0] = ""  # the smallest id of all: every later claim yields to it
    return keeps


def _ask_holders(candidate: Node, me: str, **camera: Any) -> list[Received[Ack]]:
    """The answers of those who have the camera, or any camera if none is given."""
    claim = SlotClaim(stamp_ns=clock_ns(), node=me)
    return candidate.ask_all(CAMERA_SLOT, claim, timeout_s=_ASK_TIMEOUT_S, **camera)
