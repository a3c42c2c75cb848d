"""Keepout zones, doors and lifts, as the planner tells of them; the route ``/areas``."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from fastapi import APIRouter, Query

from surveilnav import contract
from surveilnav.messages import FloorAreas
from surveilnav.messages.area import MAX_ENTRIES
from surveilnav.rest import ID_PATTERN, ROOT, Area, Items
from surveilnav.services.gateway.core.areas import areas_from_message
from surveilnav.services.gateway.responses import Limit, Offset, page_of
from surveilnav.services.gateway.state import BuildingState


class _Made(NamedTuple):
    """The resources that were made of a message, so that each message is looked through once."""

    message: FloorAreas
    stale: bool
    areas: list[Area]


class Areas:
    """The areas of all floors. Without a planner they are what it told last."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node
        self._made: dict[str, _Made] = {}

    def all(self, floor: str | None = None) -> list[Area]:
        """Every area, by floor; with a ``floor``, those on it."""
        gone, known = not self._state.alive("planner"), self._state.areas
        made: dict[str, _Made] = {}
        for name, row in list(known.newest("floor").items())[:MAX_ENTRIES]:
            before, stale = self._made.get(name), gone or known.is_old(row)
            if before is not None and before.message is row.message and before.stale == stale:
                made[name] = before
                continue
            areas, faults = areas_from_message(row.message, row.received_ns, stale=stale)
            for fault in faults:
                self._node.reject(contract.FLOOR_AREAS.name, f"floor {name}: {fault}")
            made[name] = _Made(row.message, stale, areas)
        self._made = made
        return [area for name, one in made.items() if floor in (None, name) for area in one.areas]


def router(areas: Areas) -> APIRouter:
    """The address ``/areas``."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/areas", name="areas")
    def list_areas(
        floor: Annotated[str | None, Query(pattern=ID_PATTERN)] = None, limit: Limit = 100, offset: Offset = 0
    ) -> Items[Area]:
        """Keepout zones, doors and lifts, with the state of each passage."""
        return page_of(areas.all(floor), limit, offset)

    return router
