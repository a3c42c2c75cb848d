"""Listing, downloading and deleting recordings, and replaying one; ``/recordings``, ``/recorders`` and ``/replay``.

The files are the recorders'; the gateway reads them over the bus.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain, islice
from typing import Annotated

from fastapi import APIRouter, Header, Path, Query, Request, Response
from fastapi.responses import StreamingResponse

from surveilnav import contract
from surveilnav.bus import Received, clock_ns
from surveilnav.messages import RecordingPart, RecordingRemoval, ReplayControl, ReplayStatus
from surveilnav.rest import ROOT, GrowingItems, Items, Recorder, Recording, Replay, ReplayChange
from surveilnav.services.gateway.access_log import ALL_VIEWS, AccessLog
from surveilnav.services.gateway.bus_requests import absent
from surveilnav.services.gateway.bus_requests import request as bus_request
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import recorder_from_status, recording_from_message, replay_from_status
from surveilnav.services.gateway.core.selection import SortKey, byte_range, page_after
from surveilnav.services.gateway.responses import Cursor, Limit, Offset, Responses, page_of
from surveilnav.services.gateway.state import BuildingState

_ATTEMPTS = 3
_PART_BYTES = 1 << 20
_RecordingId = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
_FILE = {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}
_MCAP: Responses = {
    200: {"content": _FILE, "description": "the file"},
    206: {"content": _FILE, "description": "the range of it that was asked for"},
}


class Recordings:
    """The recordings of all recorders that are alive."""

    def __init__(self, state: BuildingState) -> None:
        self._state, self._node = state, state.node

    def recorders(self) -> list[Recorder]:
        """Every recorder that has ever published its status. Those that have left are stale."""
        alive, statuses = self._node.alive("recorder"), self._state.recorders
        return [
            recorder_from_status(row.message, row.received_ns, id not in alive or statuses.is_old(row))
            for id, row in statuses.newest("recorder").items()
        ]

    def page(self, mission: str, cursor: str | None, offset: int, limit: int) -> GrowingItems[Recording]:
        """At most ``limit`` recordings, newest first, after a cursor or from ``offset``; of one mission, if it is named."""
        rows = sorted((r for r in self._all() if mission in ("", r.mission)), key=_sort_key)
        page, next_cursor = page_after(rows, _sort_key, cursor, offset, limit)
        return GrowingItems(items=page, total=len(rows), next=next_cursor)

    def one(self, id: str) -> Recording:
        """One recording; 404 if no recorder has it."""
        for recording in self._all():
            if recording.id == id:
                return recording
        raise Problem(
            404, "unknown_recording", f"no recording {id!r}: it may have been the oldest when room was needed"
        )

    def cameras_in(self, recording: Recording) -> list[str]:
        """The cameras whose pictures a recording may contain. If the recording doesn't say, these are all known cameras."""
        known = self._state.cameras.newest("camera")
        return sorted(known) if recording.cameras is None else recording.cameras

    def delete(self, id: str) -> None:
        """Deletes a recording for good; one that is being written can't be deleted (409)."""
        recorder = self.one(id).recorder
        removal = RecordingRemoval(stamp_ns=clock_ns(), id=id)
        bus_request(self._node, f"recorder {recorder}", contract.RECORDING_DELETE, removal, recorder=recorder)

    def parts(self, recording: Recording, first: int, after: int) -> Iterator[bytes]:
        """The bytes of a recording from index ``first`` up to, but without, ``after``; one part at a time is in memory."""
        owner = f"recorder {recording.recorder}"
        while first < after:
            part = RecordingPart(
                stamp_ns=clock_ns(), id=recording.id, offset=first, n_bytes=min(_PART_BYTES, after - first)
            )
            data = self._read(owner, part, recording.recorder)
            if not 0 < len(data) <= part.n_bytes:
                raise Problem(
                    502, "bad_part", f"{owner} answered with {len(data)} bytes where {part.n_bytes} were asked for"
                )
            first += len(data)
            yield data

    def _read(self, owner: str, part: RecordingPart, recorder: str) -> bytes:
        """Reads one part of a file. If the answer is lost because a link is full, the request is repeated."""
        for attempt in range(_ATTEMPTS):
            try:
                return bus_request(self._node, owner, contract.RECORDING_READ, part, recorder=recorder).payload
            except Problem as problem:
                if problem.status != 504 or attempt == _ATTEMPTS - 1:
                    raise
        raise AssertionError("the last attempt returns or raises")

    def _all(self) -> list[Recording]:
        recorders = sorted(self._node.alive("recorder"))
        if not recorders:
            raise absent("recorder")
        return [
            recording_from_message(recording, recorder, self._state.root)
            for recorder in recorders
            for recording in bus_request(
                self._node, f"recorder {recorder}", contract.RECORDINGS, recorder=recorder
            ).message.recordings
        ]


def _sort_key(recording: Recording) -> SortKey:
    started_ms = int(recording.started.timestamp() * 1000) if recording.started else 0
    return -started_ms, recording.mission


class Replays:
    """The replay of a recording, if the gateway shows one instead of a running building.

    ``on_jump`` is called when the replay jumps to another moment, since what was remembered may be from its future.
    """

    def __init__(self, state: BuildingState, on_jump: Callable[[], None]) -> None:
        self._state, self._node, self._on_jump = state, state.node, on_jump
        self._jumps: dict[str, int] = {}
        state.replays.on_message = self._on_status

    def current(self) -> Replay | None:
        """The replay; None if the gateway shows a running building."""
        row = self._newest()
        if row is None:
            return None
        return replay_from_status(row.message, row.received_ns, self._state.replays.is_old(row))

    def one(self) -> Replay:
        """The replay. Problem 404: the gateway shows a running building."""
        if (found := self.current()) is None:
            raise _no_replay()
        return found

    def change(self, wanted: ReplayChange) -> Replay:
        """Makes the replay play, pause, jump to a moment, or change its speed."""
        if (row := self._newest()) is None:
            raise _no_replay()
        control = ReplayControl(stamp_ns=clock_ns(), **wanted.model_dump())
        answer = bus_request(self._node, "replay", contract.REPLAY_CONTROL, control, player=row.ids["player"])
        return replay_from_status(answer.message, answer.received_ns, stale=False)

    def _newest(self) -> Received[ReplayStatus] | None:
        """The newest status of a player that is alive."""
        alive = self._node.alive("replay")
        return next((row for id, row in self._state.replays.newest("player").items() if id in alive), None)

    def _on_status(self, row: Received[ReplayStatus]) -> None:
        jumps, player = row.message.jumps, row.ids["player"]
        if self._jumps.get(player, jumps) != jumps:
            self._on_jump()
        self._jumps[player] = jumps


def _no_replay() -> Problem:
    detail = "this is no recording: `surveilnav replay FILE` shows one, on a gateway of its own"
    return Problem(404, "no_replay", detail)


def _file_response(recordings: Recordings, asked: Recording, range: str, if_range: str) -> StreamingResponse:
    """A recording's file, or the part of it that the headers ``Range`` and ``If-Range`` ask for."""
    total, tag = asked.n_bytes, f'"{asked.id}-{asked.n_bytes}"'
    part = byte_range(range, total) if range and if_range in ("", tag) else None
    first, after = part or (0, total)
    headers = {
        "Accept-Ranges": "bytes",
        "ETag": tag,
        "Content-Length": str(after - first),
        "Content-Disposition": f'attachment; filename="{asked.id}.mcap"',
    }
    if part:
        headers["Content-Range"] = f"bytes {first}-{after - 1}/{total}"
    parts = recordings.parts(asked, first, after)
    begin = list(islice(parts, 1))  # so that a problem is answered before anything is sent
    return StreamingResponse(chain(begin, parts), 206 if part else 200, headers, media_type="application/octet-stream")


def router(recordings: Recordings, replays: Replays, access_log: AccessLog) -> APIRouter:
    """The addresses of recordings, recorders and the replay."""
    router = APIRouter(prefix=ROOT, tags=["recordings"])

    @router.get("/recorders", name="recorders")
    def list_recorders(limit: Limit = 100, offset: Offset = 0) -> Items[Recorder]:
        """All recorders, with the problems that they report."""
        return page_of(recordings.recorders(), limit, offset)

    @router.get("/recordings", name="recordings")
    def list_recordings(
        mission: Annotated[str, Query(max_length=64)] = "",
        limit: Limit = 100,
        offset: Offset = 0,
        cursor: Cursor = None,
    ) -> GrowingItems[Recording]:
        """Recordings, newest first; only of one ``mission``, if it is named. ``cursor`` is the ``next`` of the page before."""
        return recordings.page(mission, cursor, offset, limit)

    @router.get("/recordings/{id}")
    def recording(id: _RecordingId) -> Recording:
        return recordings.one(id)

    @router.get("/recordings/{id}/file", response_class=Response, responses=_MCAP)
    def file(
        request: Request,
        id: _RecordingId,
        range: Annotated[str, Header(max_length=100)] = "",
        if_range: Annotated[str, Header(max_length=200)] = "",
    ) -> Response:
        """The recording as an MCAP file; with ``Range`` a part of it, so that a download can be resumed. Of a recording that is
        being written, the answer is what exists now. A download counts as an access to each camera in the recording."""
        asked = recordings.one(id)
        response = _file_response(recordings, asked, range, if_range)
        for camera in recordings.cameras_in(asked):
            access_log.record(request, camera, ALL_VIEWS, "recording")
        return response

    @router.delete("/recordings/{id}", status_code=204)
    def delete(id: _RecordingId) -> None:
        """Deletes a recording for good. One that is being written can't be deleted: cancel its mission first."""
        recordings.delete(id)

    @router.get("/replay")
    def replay() -> Replay:
        """The state of the replay that `surveilnav replay` shows; 404 `no_replay` if this gateway shows a running building."""
        return replays.one()

    @router.patch("/replay")
    def change(wanted: ReplayChange) -> Replay:
        """Makes the replay play, pause, jump to a moment (`at_s`, also backwards), or change its speed. A long jump takes
        seconds, because the state at that moment is computed from the beginning."""
        return replays.change(wanted)

    return router
