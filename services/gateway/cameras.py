"""Cameras and their pictures, pausing cameras, and forgetting past pictures; the routes ``/cameras`` and ``/pictures``."""

from __future__ import annotations

import threading
from typing import Annotated

from fastapi import APIRouter, Path, Query, Request, Response

from surveilnav import contract
from surveilnav.bus import Node, clock_ns
from surveilnav.messages import CameraInfo, CameraRequest, ForgetPictures
from surveilnav.rest import ROOT, AccessRecord, Camera, CameraCone, Items, PictureKeeper
from surveilnav.services.gateway.access_log import AccessLog
from surveilnav.services.gateway.answer_cache import AnswerCache
from surveilnav.services.gateway.bus_requests import request as bus_request
from surveilnav.services.gateway.core.camera_views import floor_outline
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import camera_from_info
from surveilnav.services.gateway.responses import (
    JPEG,
    NOT_CHANGED,
    Id,
    IfNoneMatch,
    Limit,
    Offset,
    etag_response,
    page_of,
)
from surveilnav.services.gateway.state import BuildingState

_CLEANING_PERIOD_S = 30.0
#: Cached thumbnails are removed at this age. They are only shown for a second, so older ones are of no use.
_THUMBNAIL_AGE_S = 60.0
_View = Annotated[int, Path(ge=0, le=65535)]


class Cameras:
    """All cameras that have announced themselves. Those that have left the bus are marked as stale."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node
        self.thumbnails: AnswerCache[bytes] = AnswerCache()  # by camera and view

    def all(self) -> list[Camera]:
        """Every camera, with how many of its views the maps hold, and what it last detected."""
        uses = {u.camera: u for r in self._state.revisions.rows() for u in r.message.cameras}
        summaries = self._state.summaries.newest("camera")
        alive = self._node.alive("camera")
        found = []
        for id, row in self._state.cameras.newest("camera").items():
            summary = summaries.get(id)
            seen_ns = max(row.received_ns, summary.received_ns if summary else 0)
            labels = summary.message.labels if summary else {}
            found.append(camera_from_info(row.message, uses.get(id), labels, seen_ns, id in alive, self._state.root))
        return found

    def one(self, id: str) -> Camera:
        """One camera; 404 if it has never announced itself."""
        for camera in self.all():
            if camera.id == id:
                return camera
        raise Problem(
            404, "unknown_camera", f"no camera {id!r} has announced itself; {ROOT}/cameras lists those that have"
        )

    def thumbnail(self, id: str, view: int, width_px: int = 0) -> bytes:
        """A JPEG that the camera makes for this call. That counts as viewer traffic and doesn't invoke the camera.

        ``width_px``: limited by the camera's settings; 0 is the widest.
        """
        camera = self.one(id)
        views = sorted(v.view for v in camera.views)
        if view not in views:
            raise Problem(404, "unknown_view", f"camera {id} has the views {', '.join(map(str, views))}, not {view}")
        message = CameraRequest(stamp_ns=clock_ns(), action="thumbnail", views=[view], width_px=width_px)
        row = bus_request(self._node, f"camera {id}", contract.CAMERA_REQUEST, message, floor=camera.floor, camera=id)
        if not row.payload.startswith(b"\xff\xd8"):
            raise Problem(502, "bad_picture", f"camera {id} answered with {len(row.payload)} bytes that are no JPEG")
        return row.payload

    def first_view(self, id: str) -> int:
        """The number of a camera's first view; 404 if the camera has never announced itself."""
        return min((v.view for v in self.one(id).views), default=0)

    def latest(self, id: str, view: int) -> bytes:
        """A thumbnail that is at most a second old. All viewers within that second get the same picture."""
        return self.thumbnails.get((id, view), lambda: self.thumbnail(id, view))

    def cones(self, id: str) -> list[CameraCone]:
        """The area of floor that each view of a camera shows."""
        self.one(id)  # 404
        info: CameraInfo = self._state.cameras.newest("camera")[id].message
        floor_z_m = info.position_m[2] - info.mounting_offset_m
        return [
            CameraCone(view=v.view, outline_m=floor_outline(v.T_world_camera, info.intrinsics, floor_z_m))
            for v in info.views
        ]

    def pause(self, id: str, *, paused: bool) -> Camera:
        """Has a camera look at nothing and send nothing, or look again."""
        camera = self.one(id)
        message = CameraRequest(stamp_ns=clock_ns(), action="pause" if paused else "resume")
        bus_request(self._node, f"camera {id}", contract.CAMERA_REQUEST, message, floor=camera.floor, camera=id)
        return camera.model_copy(update={"paused": paused})

    def remove(self, id: str) -> None:
        """Forgets a camera that is gone. One that is there would announce itself again, so it isn't removed (409)."""
        if not self.one(id).stale:
            detail = f"camera {id} is there: end its process first, or pause it with POST {ROOT}/cameras/{id}/pause"
            raise Problem(409, "camera_present", detail)
        self._state.cameras.forget("camera", id)
        self._state.summaries.forget("camera", id)


class PastPictures:
    """Removes past pictures: old ones of the gateway regularly, on a thread; all of all services on request."""

    def __init__(self, node: Node, thumbnails: AnswerCache[bytes], access_log: AccessLog) -> None:
        self._node, self._thumbnails, self._access_log = node, thumbnails, access_log
        node.alive("fusion")  # the first call starts watching
        threading.Thread(target=self._run, name="remove old pictures", daemon=True).start()

    def forget(self) -> list[PictureKeeper]:
        """Has every service forget past pictures, and returns what each answered.

        Raises:
            Problem: fusion is alive but doesn't answer (504, with the answers of the other services).
        """
        message = ForgetPictures(stamp_ns=clock_ns(), reason="a client of the gateway asked for it")
        n_dropped = self._thumbnails.drop_older(0.0)
        keepers = [PictureKeeper(keeper="gateway", message=f"{n_dropped} thumbnails are gone")]
        answers = {
            r.ids["keeper"]: r.message for r in self._node.ask_all(contract.FORGET_PICTURES, message, timeout_s=2.0)
        }
        keepers += [PictureKeeper(keeper=keeper, message=answers[keeper].message) for keeper in sorted(answers)]
        if silent := sorted(self._node.alive("fusion") - set(answers)):
            detail = f"{', '.join(silent)} didn't say that it forgets its pictures: try again"
            raise Problem(504, "keeper_silent", detail, keepers=[k.model_dump() for k in keepers])
        return keepers

    def _run(self) -> None:
        while not self._node.stopping.wait(_CLEANING_PERIOD_S):
            self._thumbnails.drop_older(_THUMBNAIL_AGE_S)
            self._access_log.remove_old_files()


def router(cameras: Cameras, pictures: PastPictures, access_log: AccessLog) -> APIRouter:
    """The addresses below ``/cameras``, and ``/pictures``."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/cameras", name="cameras")
    def list_cameras(limit: Limit = 100, offset: Offset = 0) -> Items[Camera]:
        return page_of(cameras.all(), limit, offset)

    @router.get("/cameras/{id}")
    def camera(id: Id) -> Camera:
        return cameras.one(id)

    @router.get("/cameras/{id}/views/{view}.jpg", response_class=Response, responses=JPEG)
    def picture(request: Request, id: Id, view: _View) -> Response:
        """A thumbnail that the camera makes for this request. It counts as viewer traffic and doesn't invoke the camera."""
        jpeg = cameras.thumbnail(id, view)
        access_log.record(request, id, view, "thumbnail")
        return Response(jpeg, media_type="image/jpeg", headers={"Cache-Control": "no-store"})

    @router.get("/cameras/{id}/latest.jpg", response_class=Response, responses=JPEG | NOT_CHANGED)
    def latest(
        request: Request,
        id: Id,
        view: Annotated[int | None, Query(ge=0, le=65535)] = None,
        if_none_match: IfNoneMatch = "",
    ) -> Response:
        """A picture at most a second old, of ``view`` or else of the first view. Many viewers share one picture."""
        chosen = cameras.first_view(id) if view is None else view
        jpeg = cameras.latest(id, chosen)
        access_log.record(request, id, chosen, "latest")
        return etag_response(jpeg, "image/jpeg", {}, if_none_match)

    @router.get("/cameras/{id}/looks", name="looked")
    def access_records(id: Id, limit: Limit = 100, offset: Offset = 0) -> Items[AccessRecord]:
        """Who was shown pictures of a camera, and when, newest first. Also works for a camera that was removed."""
        return page_of(access_log.records_of(id), limit, offset)

    @router.get("/cameras/{id}/cones")
    def cones(id: Id) -> Items[CameraCone]:
        """The area of floor that each view shows."""
        return page_of(cameras.cones(id))

    _add_changes(router, cameras, pictures)
    return router


def _add_changes(router: APIRouter, cameras: Cameras, pictures: PastPictures) -> None:
    """Adds the addresses that pause or remove a camera, or forget pictures."""

    @router.post("/cameras/{id}/pause", status_code=202)
    def pause(id: Id) -> Camera:
        """Pauses a camera: it takes and sends no pictures until it is resumed or its process is restarted."""
        return cameras.pause(id, paused=True)

    @router.post("/cameras/{id}/resume", status_code=202)
    def resume(id: Id) -> Camera:
        """Resumes a paused camera."""
        return cameras.pause(id, paused=False)

    @router.delete("/cameras/{id}", status_code=204)
    def remove(id: Id) -> None:
        """Removes a camera whose process has ended. It is listed again when its process is started again."""
        cameras.remove(id)

    @router.delete("/pictures", status_code=202)
    def forget() -> Items[PictureKeeper]:
        """Has all services forget past pictures, within seconds. Maps, reports in folders and recordings stay."""
        return page_of(pictures.forget())
