"""Answers searches with cameras alone: invokes the cameras of a floor and waits until all their views were looked at.

The answer also says how much of the building's rooms the cameras see, so that "not seen" can be told from "not there".
"""

from __future__ import annotations

import time

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.errors import TargetError
from surveilnav.messages import CameraInfo, CameraSearch, CameraSearchReport, CameraUse, Room, RoomInView
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core.views.coverage import is_outline, room_shares
from surveilnav.services.fusion.core.views.order import ViewFootprint
from surveilnav.services.fusion.intake.intake import ViewIntake
from surveilnav.services.fusion.shard import Shard
from surveilnav.words import validate_word

_MAX_S = 50.0
#: So long it takes until views that were looked at before are handed to perception again for a new word.
_SETTLED_S, _POLL_S = 0.5, 0.1


class CameraSearchAnswers:
    """Answers ``CAMERA_SEARCH``. Each answer takes a while, so it needs workers of its own."""

    def __init__(self, node: Node, maps: BuildingMaps, intake: ViewIntake, shard: Shard) -> None:
        self._node, self._maps, self._intake, self._shard = node, maps, intake, shard

    def search(self, request: Request) -> Answer | list[Answer]:
        """Looks for something with all cameras of a floor, or of all floors of the shard.

        A floor of another shard gets no answer from this one. Refused: bad_target, bad_room, no_camera.
        """
        wanted: CameraSearch = request.message
        floor = wanted.floor or None
        if floor is not None and not self._shard.includes(floor):
            return []
        try:
            target = validate_word(wanted.target)
        except TargetError as error:
            raise Refused("bad_target", str(error)) from error
        if bad := next((room for room in wanted.rooms if not is_outline(room.outline_m)), None):
            raise Refused("bad_room", f"expected at least 3 corners in metres around room {bad.name!r:.80}")
        if not self._on(floor):
            raise Refused(
                "no_camera", f"no camera has announced itself on {f'floor {floor!r}' if floor else 'any floor'}"
            )
        begun_s = time.monotonic()
        until_s = begun_s + min(max(wanted.max_s, 0.0), _MAX_S)
        with self._intake.searches.open(target, floor):
            while time.monotonic() < until_s and not self._node.stopping.wait(_POLL_S):
                if time.monotonic() - begun_s >= _SETTLED_S and not any(map(self._is_awaited, self._on(floor))):
                    break
            return Answer(self._report(target, floor, wanted.rooms))

    def _on(self, floor: str | None) -> list[CameraInfo]:
        return [info for info in self._intake.announced_cameras() if floor in (None, info.floor)]

    def _is_awaited(self, info: CameraInfo) -> bool:
        """Whether more is to come of a camera."""
        if info.paused or info.stream.state not in ("live", "connecting"):
            return False
        invoked = self._intake.cameras.get(info.camera)
        if invoked is not None and invoked.is_silent:
            return False
        is_missing = self._n_processed(info) < len(info.views) or self._intake.awaits_pictures(info.camera)
        return is_missing or self._intake.is_perceiving(info.camera)

    def _n_processed(self, info: CameraInfo) -> int:
        return len(self._maps.processed.views_of(info.camera) & {view.view for view in info.views})

    def _report(self, target: str, floor: str | None, rooms: list[Room]) -> CameraSearchReport:
        infos = sorted(self._on(floor), key=lambda info: info.camera)
        with self._maps.lock:
            quarantined = self._maps.joint.quarantine.reasons()
        lacking = {
            info.camera: why
            for info in infos
            if (why := self._why_lacking(info, quarantined.get(f"camera/{info.camera}", "")))
        }
        uses = [CameraUse(info.camera, self._n_processed(info), len(info.views)) for info in infos]
        in_view = self._in_view(
            [room for room in rooms if floor in (None, room.floor) and self._shard.includes(room.floor)], infos
        )
        return CameraSearchReport(
            stamp_ns=clock_ns(), target=target, cameras=uses, lacking=lacking, complete=not lacking, rooms=in_view
        )

    def _in_view(self, rooms: list[Room], infos: list[CameraInfo]) -> list[RoomInView]:
        """How much the cameras see of each room. A camera that gives no pictures sees nothing."""
        range_m = self._maps.joint.config.map.max_range_camera_m
        answers: list[RoomInView] = []
        for floor in sorted({room.floor for room in rooms}):
            views: dict[str, list[ViewFootprint]] = {}
            floor_z_m = None
            for info in infos:
                if info.floor == floor and self._n_processed(info):
                    floor_z_m = info.position_m[2] - info.mounting_offset_m
                    views[info.camera] = [
                        ViewFootprint.from_view(v.T_world_camera.matrix(), info.intrinsics, floor_z_m, range_m)
                        for v in info.views
                    ]
            with self._maps.lock:
                joint = self._maps.joint
                known = None if floor_z_m is None else joint.known_floor(joint.floor_at(floor_z_m))
            for room in (room for room in rooms if room.floor == floor):
                share, by_camera = room_shares(room.outline_m, views, known)
                cameras = sorted(by_camera, key=lambda camera: -by_camera[camera])
                answers.append(RoomInView(floor=floor, name=room.name, share=share, cameras=cameras))
        return answers

    def _why_lacking(self, info: CameraInfo, quarantine: str) -> str:
        """Why not every view of a camera was looked at; "" if every one was."""
        if info.paused:
            return "paused"
        if quarantine:
            return f"it is in quarantine: {quarantine}"
        if info.stream.state != "live":
            return f"its stream is {info.stream.state}{f': {info.stream.reason}' if info.stream.reason else ''}"
        return "its views didn't come in time" if self._is_awaited(info) else ""
