"""Leases a slot of the camera plan to this process, because replicas of a container don't know their number.

The process that holds a slot answers queries on its key. A process without one asks which keys answer, takes a free slot and
asks again; if several took the same one, the smallest id keeps it. A holder that dies stops answering, so its slot is free
at once.
"""

from __future__ import annotations

import uuid
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from surveilnav.bus import Answer, BusSettings, Node, Received, clock_ns
from surveilnav.camera_plan import CameraPlan, PlannedCamera
from surveilnav.contract import CAMERA_SLOT
from surveilnav.errors import ConfigError
from surveilnav.messages import Ack, SlotClaim
from surveilnav.services.camera_node import core

_ASK_TIMEOUT_S = 1.0
_RETRY_S = 0.5
#: How long a rival's claim may take to reach the router.
_CLAIM_S = 0.3


def find_camera(plan: CameraPlan, name: str) -> PlannedCamera:
    """The camera of that name.

    Raises:
        ConfigError: the plan has no such camera; the message lists those it has.
    """
    camera = plan.camera(name)
    if camera is None:
        raise ConfigError(f"no camera {name!r} in the plan of {plan.building}; it has {[c.name for c in plan.cameras]}")
    return camera


@contextmanager
def lease(plan: CameraPlan, settings: BusSettings, wait_s: float = 3.0) -> Iterator[tuple[PlannedCamera, Node] | None]:
    """A free camera of the plan, and the node that holds its slot until the block ends; None if none is free in time."""
    with ExitStack() as stack:
        yield _acquire(plan, settings, wait_s, stack)


def _acquire(
    plan: CameraPlan, settings: BusSettings, wait_s: float, stack: ExitStack
) -> tuple[PlannedCamera, Node] | None:
    """Acquires a slot and leaves its node open in ``stack``."""
    me = uuid.uuid4().hex[:12]
    with Node("camera-candidate", me, settings, alive=False) as candidate:
        stop_ns = clock_ns() + int(wait_s * 1e9)
        while clock_ns() < stop_ns:
            taken = {int(a.ids["slot"]) for a in _ask_holders(candidate, me) if a.ids["slot"].isdecimal()}
            slot = core.choose_slot(taken, len(plan.cameras), me)
            if slot is None:
                candidate.stopping.wait(_RETRY_S)
                continue
            camera = plan.cameras[slot]
            with ExitStack() as trial:
                holder = trial.enter_context(Node("camera", camera.name, settings))
                if _claim(candidate, holder, slot, me):
                    stack.enter_context(trial.pop_all())
                    return camera, holder
    return None


def _claim(candidate: Node, holder: Node, slot: int, me: str) -> bool:
    """Has ``holder`` answer on the slot, and returns whether it may keep it."""
    claimed_by = [me]
    holder.serve(CAMERA_SLOT, lambda _: Answer(Ack(stamp_ns=clock_ns(), message=claimed_by[0])), slot=slot)
    candidate.stopping.wait(_CLAIM_S)
    rivals = {a.message.message for a in _ask_holders(candidate, me, slot=slot)}
    keeps = core.keeps_slot(me, rivals - {me})
    if keeps:
        claimed_by[0] = ""  # the smallest id of all: every later claim yields to it
    return keeps


def _ask_holders(candidate: Node, me: str, **slot: Any) -> list[Received[Ack]]:
    """The answers of those who hold the slot, or any slot if none is given."""
    claim = SlotClaim(stamp_ns=clock_ns(), node=me)
    return candidate.ask_all(CAMERA_SLOT, claim, timeout_s=_ASK_TIMEOUT_S, **slot)
