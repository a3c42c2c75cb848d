"""What is wrong in the building, and since when."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime

from surveilnav.cli.watching.system_state import SystemState


class Alerts:
    """Remembers when each fault was first told of: what has no time of its own is known since then."""

    def __init__(self) -> None:
        self._since: dict[str, datetime] = {}

    def of(self, known: SystemState, now: datetime) -> list[tuple[str, datetime]]:
        """Each fault and since when it has been there, the oldest first."""
        found = dict(_faults(known))
        self._since = {what: self._since.get(what, now) for what in found}
        return sorted(((what, when or self._since[what]) for what, when in found.items()), key=lambda fault: fault[1])


def _faults(known: SystemState) -> Iterator[tuple[str, datetime | None]]:
    """What is wrong; and when it was last right, where somebody knows."""
    if known.lost:
        yield "the gateway doesn't answer", known.lost
        return  # all else is as old
    for camera in known.cameras:
        if camera.stale:
            yield f"camera {camera.id} is offline", camera.last_seen
    for robot in known.robots:
        if robot.stale:
            yield f"robot {robot.id} is silent", robot.last_seen
    for service in known.services:
        if service.given_up:
            yield (
                f"{service.id} was given up after {service.restarts} restarts: {service.why or 'see its log'}",
                None,
            )
        elif not service.running:
            yield f"{service.id} has ended: {service.why or 'it starts again'}", None
    for worker in known.perception:
        if worker.stale:
            yield f"perception worker {worker.id} is silent", worker.last_seen
    for floor in known.floors:
        if floor.perception_ok is False:
            yield f"perception is down for floor {floor.id}: {floor.message or 'see `surveilnav status`'}", None
    for building in known.buildings:
        if not building.ready:
            yield f"no mission can run in {building.id} now: see `surveilnav status`", None
