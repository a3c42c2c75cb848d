"""``/missions``."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, Body, Header, Query, Response

from surveilnav.services.gateway.core.resources import (
    ROOT,
    GrowingItems,
    Mission,
    MissionPlan,
    MissionTraffic,
    NewMission,
)
from surveilnav.services.gateway.costs import MissionCosts
from surveilnav.services.gateway.missions import Missions
from surveilnav.services.gateway.routes.paging import Id, Limit, Offset


def router(found: Missions, costs: MissionCosts) -> APIRouter:
    """Submit, list, follow, pause and cancel missions."""
    router = APIRouter(prefix=f"{ROOT}/missions", tags=["missions"])

    @router.post("", status_code=202)
    def submit(
        goal: NewMission,
        response: Response,
        idempotency_key: Annotated[str | None, Header(min_length=1, max_length=255)] = None,
    ) -> Mission:
        """Submits a mission. With an Idempotency-Key, a repeated request is the same mission."""
        mission = found.submit(goal, idempotency_key)
        response.headers["Location"] = f"{found.root}/missions/{mission.id}"
        return mission

    @router.get("")
    def missions(
        limit: Limit = 100, offset: Offset = 0, cursor: Annotated[str | None, Query(max_length=100)] = None
    ) -> GrowingItems[Mission]:
        """Missions, newest first. ``cursor``: the ``next`` of the page before; it goes on there, whatever was submitted
        meanwhile."""
        return found.page(cursor, offset, limit)

    @router.get("/{id}")
    def mission(id: Id) -> Mission:
        return found.get(id)

    @router.post("/{id}/cancel", status_code=202)
    def cancel(id: Id, reason: Annotated[str, Body(embed=True, max_length=500)] = "") -> Mission:
        """Cancels a mission; its robot stops."""
        return found.cancel(id, reason)

    @router.post("/{id}/pause", status_code=202)
    def pause(id: Id, reason: Annotated[str, Body(embed=True, max_length=500)] = "") -> Mission:
        """Pauses a mission: its robot ends its action and stays where it is."""
        return found.pause(id, reason, paused=True)

    @router.post("/{id}/resume", status_code=202)
    def resume(id: Id) -> Mission:
        """Has a paused mission go on."""
        return found.pause(id, "", paused=False)

    @router.get("/{id}/plan")
    def plan(id: Id) -> MissionPlan:
        """The planner's present plan: waypoint, path, and what else it weighed."""
        return found.plan(id)

    @router.get("/{id}/traffic")
    def traffic(id: Id) -> MissionTraffic:
        """What cameras and robots sent while it ran, and what that may come to."""
        return costs.one(id)

    return router
