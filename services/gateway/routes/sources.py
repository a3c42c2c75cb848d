"""``/robots``, ``/perception``."""

from __future__ import annotations

from fastapi import APIRouter

from surveilnav.services.gateway.core.resources import ROOT, Items, Robot, RobotHalt, Target, Worker
from surveilnav.services.gateway.routes.paging import Limit, Offset, page_of
from surveilnav.services.gateway.sources import Sources


def router(found: Sources) -> APIRouter:
    """Robots, released, and perception workers."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/robots")
    def robots(limit: Limit = 100, offset: Offset = 0) -> Items[Robot]:
        return page_of(found.robots(), limit, offset)

    @router.post("/robots/release")
    def release() -> Items[RobotHalt]:
        """Releases all robots. Nothing moves by that: missions stay paused until each is resumed."""
        return page_of(found.halt(False, ""), 1000, 0)

    @router.get("/perception")
    def perception(limit: Limit = 100, offset: Offset = 0) -> Items[Worker]:
        """Perception workers, the backend that each runs, and why that one."""
        return page_of(found.workers(), limit, offset)

    @router.get("/targets")
    def targets(limit: Limit = 1000, offset: Offset = 0) -> Items[Target]:
        """Names of what can be searched for. A worker with an open vocabulary has none here: it knows any word."""
        return page_of(found.targets(), limit, offset)

    return router
