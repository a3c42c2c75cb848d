"""Cameras: what they show, and what a person has them do."""

from __future__ import annotations

from surveilnav import contract
from surveilnav.bus import clock_ns
from surveilnav.messages import CameraInfo, CameraRequest
from surveilnav.services.gateway.asking import ask
from surveilnav.services.gateway.core.cones import floor_outline
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import ROOT, Camera, CameraCone
from surveilnav.services.gateway.single_flight import SingleFlight
from surveilnav.services.gateway.state import BuildingState


class Cameras:
    """All cameras that ever announced themselves, those that left as stale."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node
        self.thumbnails: SingleFlight[bytes] = SingleFlight()  # by camera and view

    def all(self) -> list[Camera]:
        """Every camera, with what the maps hold of it and what it last saw."""
        uses = {u.camera: u for r in self._state.revisions.rows() for u in r.message.cameras}
        summaries = self._state.summaries.newest("camera")
        alive = self._node.alive("camera")
        found = []
        for id, row in self._state.cameras.newest("camera").items():
            summary = summaries.get(id)
            seen_ns = max(row.received_ns, summary.received_ns if summary else 0)
            labels = summary.message.labels if summary else {}
            found.append(Camera.from_info(row.message, uses.get(id), labels, seen_ns, id in alive, self._state.root))
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
        """A JPEG that the camera makes for this viewer: counted as viewer traffic, no invocation. ``width_px`` 0: as wide
        as the camera's settings say, which is the most."""
        camera = self.one(id)
        views = sorted(v.view for v in camera.views)
        if view not in views:
            raise Problem(404, "unknown_view", f"camera {id} has the views {', '.join(map(str, views))}, not {view}")
        request = CameraRequest(stamp_ns=clock_ns(), action="thumbnail", views=[view], width_px=width_px)
        row = ask(self._node, f"camera {id}", contract.CAMERA_REQUEST, request, floor=camera.floor, camera=id)
        if not row.payload.startswith(b"\xff\xd8"):
            raise Problem(502, "bad_picture", f"camera {id} answered with {len(row.payload)} bytes that are no JPEG")
        return row.payload

    def first_view(self, id: str) -> int:
        """The number of a camera's first view; 404 if the camera has never announced itself."""
        return min((v.view for v in self.one(id).views), default=0)

    def latest(self, id: str, view: int) -> bytes:
        """The same, at most a second old: many viewers cost the camera one picture."""
        return self.thumbnails.get((id, view), lambda: self.thumbnail(id, view))

    def cones(self, id: str) -> list[CameraCone]:
        """What each view of a camera looks at on the floor."""
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
        request = CameraRequest(stamp_ns=clock_ns(), action="pause" if paused else "resume")
        ask(self._node, f"camera {id}", contract.CAMERA_REQUEST, request, floor=camera.floor, camera=id)
        return camera.model_copy(update={"paused": paused})

    def remove(self, id: str) -> None:
        """Forgets a camera that is gone; one that is there would announce itself again (409)."""
        if not self.one(id).stale:
            detail = f"camera {id} is there: end its process first, or pause it with POST {ROOT}/cameras/{id}/pause"
            raise Problem(409, "camera_present", detail)
        self._state.cameras.forget("camera", id)
        self._state.summaries.forget("camera", id)
