"""``/recordings``, ``/recorders``."""

from __future__ import annotations

from itertools import chain, islice
from typing import Annotated, Any

from fastapi import APIRouter, Header, Path, Query, Request, Response
from fastapi.responses import StreamingResponse

from surveilnav.services.gateway.core.ranges import part_of
from surveilnav.services.gateway.core.resources import ROOT, GrowingItems, Items, Recorder, Recording
from surveilnav.services.gateway.looks import ALL_VIEWS, Looks
from surveilnav.services.gateway.recordings import Recordings
from surveilnav.services.gateway.routes.paging import Limit, Offset, page_of

RecordingId = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,99}$")]
_FILE = {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}}
_MCAP: dict[int | str, dict[str, Any]] = {
    200: {"content": _FILE, "description": "the file"},
    206: {"content": _FILE, "description": "the range of it that was asked for"},
}


def router(found: Recordings, looks: Looks) -> APIRouter:
    """Recordings, their files, and who makes them."""
    router = APIRouter(prefix=ROOT, tags=["recordings"])

    @router.get("/recorders")
    def recorders(limit: Limit = 100, offset: Offset = 0) -> Items[Recorder]:
        """Who makes recordings, and what is wrong."""
        return page_of(found.recorders(), limit, offset)

    @router.get("/recordings")
    def recordings(
        mission: Annotated[str, Query(max_length=64)] = "",
        limit: Limit = 100,
        offset: Offset = 0,
        cursor: Annotated[str | None, Query(max_length=100)] = None,
    ) -> GrowingItems[Recording]:
        """Recordings, newest first; of one ``mission`` only, if it is named. ``cursor``: the ``next`` of the page before."""
        return found.page(mission, cursor, offset, limit)

    @router.get("/recordings/{id}")
    def recording(id: RecordingId) -> Recording:
        return found.one(id)

    @router.get("/recordings/{id}/file", response_class=Response, responses=_MCAP)
    def file(
        request: Request,
        id: RecordingId,
        range: Annotated[str, Header(max_length=100)] = "",
        if_range: Annotated[str, Header(max_length=200)] = "",
    ) -> Response:
        """The recording itself, MCAP; with ``Range`` a part of it: a download can go on where it broke off. Of one that is being
        written: what there is now. A look at each camera that it shows."""
        asked = found.one(id)
        total, tag = asked.n_bytes, f'"{id}-{asked.n_bytes}"'
        part = part_of(range, total) if range and if_range in ("", tag) else None
        first, after = part or (0, total)
        headers = {
            "Accept-Ranges": "bytes",
            "ETag": tag,
            "Content-Length": str(after - first),
            "Content-Disposition": f'attachment; filename="{id}.mcap"',
        }
        if part:
            headers["Content-Range"] = f"bytes {first}-{after - 1}/{total}"
        parts = found.parts(asked, first, after)
        begin = list(islice(parts, 1))  # what is wrong is said before anything is sent
        for camera in found.shown_by(asked):
            looks.note(request, camera, ALL_VIEWS, "recording")
        return StreamingResponse(
            chain(begin, parts), 206 if part else 200, headers, media_type="application/octet-stream"
        )

    @router.delete("/recordings/{id}", status_code=204)
    def delete(id: RecordingId) -> None:
        """Deletes a recording for good. One that is being written can't be: cancel its mission first."""
        found.delete(id)

    return router
