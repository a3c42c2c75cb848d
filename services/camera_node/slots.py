"""Leasing a slot of the camera plan: replicas of a container don't know their number.

Who holds a slot answers queries on its key; who looks for one asks which keys answer, takes a free one, and
asks again: of several on the same slot the smallest id keeps it. A holder that dies stops answering, so its
slot is free at once.
"""

from __future__ import annotations

import uuid

from services.camera_node import core
from surveilnav.bus import Answer, BusSettings, Node, Request, clock_ns
from surveilnav.camera_plan import CameraPlan, PlannedCamera
from surveilnav.contract import CAMERA_SLOT
from surveilnav.errors import ConfigError
from surveilnav.messages import Ack, SlotClaim

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


def lease(plan: CameraPlan, settings: BusSettings, wait_s: float = 3.0) -> tuple[PlannedCamera, Node] | None:
    """A free camera of the plan and the (entered) node that holds its slot; None if all stay taken for ``wait_s``."""
    me = uuid.uuid4().hex[:12]
    with Node("camera-candidate", me, settings, alive=False) as candidate:
        stop_ns = clock_ns() + int(wait_s * 1e9)
        while clock_ns() < stop_ns:
            claim = SlotClaim(stamp_ns=clock_ns(), node=me)
            answers = candidate.ask_all(CAMERA_SLOT, claim, timeout_s=_ASK_TIMEOUT_S)
            taken = {int(a.ids["slot"]) for a in answers if a.ids["slot"].isdecimal()}
            slot = core.choose_slot(taken, len(plan.cameras), me)
            if slot is None:
                candidate.stopping.wait(0.5)
                continue
            camera = plan.cameras[slot]
            holder = Node("camera", camera.name, settings).__enter__()
            claimed = [me]

            def answer(_: Request, claimed: list[str] = claimed) -> Answer:
                return Answer(Ack(stamp_ns=clock_ns(), message=claimed[0]))

            holder.serve(CAMERA_SLOT, answer, slot=slot)
            candidate.stopping.wait(0.3)  # for a rival's claim to reach the router
            rivals = {
                a.message.message for a in candidate.ask_all(CAMERA_SLOT, claim, slot=slot, timeout_s=_ASK_TIMEOUT_S)
            }
            if core.keeps_slot(me, rivals - {me}):
                claimed[0] = ""  # settled: the smallest id of all, so that who comes late yields
                return camera, holder
            holder.__exit__(None, None, None)
    return None
