"""``/cameras``, ``/robots``, ``/perception``."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Body, Path, Response

from services.gateway.core.resources import ROOT, Camera, Items, Robot, RobotHalt, Worker
from services.gateway.routes.paging import Id, Limit, Offset, page_of
from services.gateway.sources import Sources

_JPEG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/jpeg": {}}, "description": "the picture"}}


def router(found: Sources) -> APIRouter:
    """Cameras and their thumbnails, robots, perception workers."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/cameras")
    def cameras(limit: Limit = 100, offset: Offset = 0) -> Items[Camera]:
        return page_of(found.cameras(), limit, offset)

    @router.get("/cameras/{id}")
    def camera(id: Id) -> Camera:
        return found.camera(id)

    @router.get("/cameras/{id}/views/{view}.jpg", response_class=Response, responses=_JPEG)
    def picture(id: Id, view: Annotated[int, Path(ge=0, le=65535)]) -> Response:
        """A thumbnail that the camera makes for this request: viewer traffic, not an invocation."""
        return Response(found.thumbnail(id, view), media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    @router.get("/robots")
    def robots(limit: Limit = 100, offset: Offset = 0) -> Items[Robot]:
        return page_of(found.robots(), limit, offset)

    @router.post("/robots/stop")
    def stop(reason: Annotated[str, Body(embed=True, max_length=200)] = "") -> Items[RobotHalt]:
        """EMERGENCY STOP: every robot stops at once, whoever drives it, and refuses to move until it is released. Its
        mission is paused."""
        return page_of(found.halt(True, reason), 1000, 0)

    @router.post("/robots/release")
    def release() -> Items[RobotHalt]:
        """Releases all robots. Nothing moves by that: missions stay paused until each is resumed."""
        return page_of(found.halt(False, ""), 1000, 0)

    @router.get("/perception")
    def perception(limit: Limit = 100, offset: Offset = 0) -> Items[Worker]:
        """Perception workers, the backend that each runs, and why that one."""
        return page_of(found.workers(), limit, offset)

    return router
