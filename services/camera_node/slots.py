"""Leasing a slot of the camera plan: replicas of a container don't know their number.

Who holds a slot answers queries on its key; who looks for one asks which keys answer, takes a free one, and
asks again: of several on the same slot the smallest id keeps it. A holder that dies stops answering, so its
slot is free at once.
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


def named(plan: CameraPlan, name: str) -> PlannedCamera:
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
    """A free camera of the plan and the node that holds its slot until the end; None if all stay taken for ``wait_s``."""
    with ExitStack() as held:
        yield _take(plan, settings, wait_s, held)


def _take(plan: CameraPlan, settings: BusSettings, wait_s: float, held: ExitStack) -> tuple[PlannedCamera, Node] | None:
    """Takes a slot and leaves its node open in ``held``."""
    me = uuid.uuid4().hex[:12]
    with Node("camera-candidate", me, settings, alive=False) as candidate:
        stop_ns = clock_ns() + int(wait_s * 1e9)
        while clock_ns() < stop_ns:
            taken = {int(a.ids["slot"]) for a in _answers(candidate, me) if a.ids["slot"].isdecimal()}
            slot = core.choose_slot(taken, len(plan.cameras), me)
            if slot is None:
                candidate.stopping.wait(0.5)
                continue
            camera = plan.cameras[slot]
            with ExitStack() as trial:
                holder = trial.enter_context(Node("camera", camera.name, settings))
                if _keeps(candidate, holder, slot, me):
                    held.enter_context(trial.pop_all())
                    return camera, holder
    return None


def _keeps(candidate: Node, holder: Node, slot: int, me: str) -> bool:
    """Whether ``holder``, which answers on the slot from now on, may keep it."""
    claimed = [me]
    holder.serve(CAMERA_SLOT, lambda _: Answer(Ack(stamp_ns=clock_ns(), message=claimed[0])), slot=slot)
    candidate.stopping.wait(0.3)  # for a rival's claim to reach the router
    rivals = {a.message.message for a in _answers(candidate, me, slot=slot)}
    keeps = core.keeps_slot(me, rivals - {me})
    if keeps:
        claimed[0] = ""  # settled: the smallest id of all, so that who comes late yields
    return keeps


def _answers(candidate: Node, me: str, **slot: Any) -> list[Received[Ack]]:
    """Who holds the slot, or any slot."""
    claim = SlotClaim(stamp_ns=clock_ns(), node=me)
    return candidate.ask_all(CAMERA_SLOT, claim, timeout_s=_ASK_TIMEOUT_S, **slot)
