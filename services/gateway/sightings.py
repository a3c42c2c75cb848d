"""Where cameras see something, without a robot; the route ``/sightings``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from fastapi import APIRouter

from surveilnav import contract
from surveilnav.bus import clock_ns
from surveilnav.messages import CameraSearch, CameraSearchReport, ObjectRecord
from surveilnav.rest import ROOT, SearchedCamera, SearchedRoom, Sighting, Sightings, SightingsRequest
from surveilnav.services.gateway.bus_requests import request, request_each
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import resource_from, utc
from surveilnav.services.gateway.core.selection import ObjectFilter
from surveilnav.services.gateway.objects import Objects
from surveilnav.services.gateway.rooms import Rooms
from surveilnav.services.gateway.state import BuildingState

#: Beside the time that the cameras may take.
_ANSWER_S = 10.0
_MAX_SIGHTINGS = 50


class CameraSightings:
    """Has fusion look with all cameras, and lists what it found."""

    def __init__(self, state: BuildingState, objects: Objects, cameras_file: Path | None = None) -> None:
        self._state, self._objects, self._rooms = state, objects, Rooms(state.node, cameras_file)

    def search(self, wanted: SightingsRequest) -> Sightings:
        """Where cameras see something. Blocks until every view was looked at, or for ``wanted.max_s``."""
        floor = wanted.floor or ""
        question = CameraSearch(
            stamp_ns=clock_ns(),
            target=wanted.target,
            floor=floor,
            max_s=wanted.max_s,
            rooms=self._rooms.all(wanted.floor),
        )
        report = self._report(question, timeout_s=wanted.max_s + _ANSWER_S)
        self._objects.clear()
        records = self._objects.records(ObjectFilter(wanted.floor, wanted.target))
        found = [r for r in records if r.status != "rejected"]
        surest = sorted(found, key=lambda r: (r.status != "confirmed", -r.confidence))[:_MAX_SIGHTINGS]
        return Sightings(
            target=report.target,
            sightings=[self._sighting(record) for record in surest],
            cameras=[
                SearchedCamera(
                    id=use.camera,
                    views=use.views,
                    views_processed=use.views_processed,
                    lacking=report.lacking.get(use.camera, ""),
                )
                for use in report.cameras
            ],
            rooms=[SearchedRoom(floor=r.floor, name=r.name, in_view=r.share, cameras=r.cameras) for r in report.rooms],
            complete=report.complete,
        )

    def _report(self, question: CameraSearch, timeout_s: float) -> CameraSearchReport:
        """What came of a search. One on all floors is put to every fusion service, each of which has floors of its own."""
        node, stream = self._state.node, contract.CAMERA_SEARCH
        if question.floor:
            row = request(node, "fusion", stream, question, timeout_s=timeout_s)
            return merged([row.message])
        reports = request_each(node, "fusion", stream, question, not_mine="no_camera", timeout_s=timeout_s)
        return merged(list(reports.values()))

    def _sighting(self, record: ObjectRecord) -> Sighting:
        return resource_from(
            Sighting,
            record,
            object=record.id,
            position_m=record.center_m,
            room=self._rooms.name_at(record.floor, *record.center_m[:2]),
            last_seen=utc(record.last_seen_ns),
            picture=self._picture(record),
        )

    def _picture(self, record: ObjectRecord) -> str | None:
        """The address of the newest picture of an object; None if its history can't be read."""
        try:
            history = self._objects.one(record.floor, record.id).history
        except Problem:  # it was merged with another one meanwhile
            return None
        number = max((i for i, event in enumerate(history) if event.box_px is not None), default=None)
        root = self._state.root
        return None if number is None else f"{root}/floors/{record.floor}/objects/{record.id}/history/{number}.jpg"


def merged(reports: Sequence[CameraSearchReport]) -> CameraSearchReport:
    """The reports of several fusion services, at least one, as a single one."""
    return CameraSearchReport(
        stamp_ns=max(report.stamp_ns for report in reports),
        target=reports[0].target,
        cameras=[use for report in reports for use in report.cameras],
        lacking={camera: why for report in reports for camera, why in report.lacking.items()},
        complete=all(report.complete for report in reports),
        rooms=[room for report in reports for room in report.rooms],
    )


def router(sightings: CameraSightings) -> APIRouter:
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.post("/sightings")
    def search(wanted: SightingsRequest) -> Sightings:
        """Has all cameras looked at for something, without a robot, and answers where it was seen, the surest first. That takes
        until every view was looked at, or ``max_s``. The answer also says which cameras gave no picture."""
        return sightings.search(wanted)

    return router
