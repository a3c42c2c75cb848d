"""``/cameras``."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Request, Response

from surveilnav.services.gateway.cameras import Cameras
from surveilnav.services.gateway.core.resources import ROOT, Camera, CameraCone, CameraLook, Items
from surveilnav.services.gateway.looks import Looks
from surveilnav.services.gateway.routes.conditional import NOT_CHANGED, IfNoneMatch, answer
from surveilnav.services.gateway.routes.paging import Id, Limit, Offset, page_of

_JPEG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/jpeg": {}}, "description": "the picture"}}


def router(found: Cameras, looks: Looks) -> APIRouter:
    """Cameras, their pictures and cones, who looked; paused, resumed, forgotten."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/cameras")
    def cameras(limit: Limit = 100, offset: Offset = 0) -> Items[Camera]:
        return page_of(found.all(), limit, offset)

    @router.get("/cameras/{id}")
    def camera(id: Id) -> Camera:
        return found.one(id)

    @router.get("/cameras/{id}/views/{view}.jpg", response_class=Response, responses=_JPEG)
    def picture(request: Request, id: Id, view: Annotated[int, Path(ge=0, le=65535)]) -> Response:
        """A thumbnail that the camera makes for this request: viewer traffic, not an invocation."""
        jpeg = found.thumbnail(id, view)
        looks.note(request, id, view, "thumbnail")
        return Response(jpeg, media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    @router.get("/cameras/{id}/latest.jpg", response_class=Response, responses=_JPEG | NOT_CHANGED)
    def latest(
        request: Request,
        id: Id,
        view: Annotated[int | None, Query(ge=0, le=65535)] = None,
        if_none_match: IfNoneMatch = "",
    ) -> Response:
        """A picture at most a second old, of the view named or the first: many viewers cost the camera one."""
        chosen = found.first_view(id) if view is None else view
        jpeg = found.latest(id, chosen)
        looks.note(request, id, chosen, "latest")
        return answer(jpeg, "image/jpeg", {}, if_none_match)

    @router.get("/cameras/{id}/looks")
    def looked(id: Id, limit: Limit = 100, offset: Offset = 0) -> Items[CameraLook]:
        """Who was shown pictures of a camera, and when, newest first; also of one that is forgotten."""
        return page_of(looks.of(id), limit, offset)

    @router.get("/cameras/{id}/cones")
    def cones(id: Id) -> Items[CameraCone]:
        """What of its floor each view looks at."""
        return page_of(found.cones(id), 1000, 0)

    @router.post("/cameras/{id}/pause", status_code=202)
    def pause(id: Id) -> Camera:
        """Has a camera look at nothing and send nothing, until it is resumed or its process is started anew."""
        return found.pause(id, paused=True)

    @router.post("/cameras/{id}/resume", status_code=202)
    def resume(id: Id) -> Camera:
        """Has a camera look again."""
        return found.pause(id, paused=False)

    @router.delete("/cameras/{id}", status_code=204)
    def remove(id: Id) -> None:
        """Forgets a camera whose process has ended. It comes back if that is started again."""
        found.remove(id)

    return router
