"""The id of a recording: when it began, and which mission it is of."""

from __future__ import annotations

import re
from datetime import UTC, datetime

from surveilnav.contract import ID

SUFFIX = ".mcap"
_ID = re.compile(rf"(?P<time>\d{{8}}T\d{{6}})(?P<ms>\d{{3}})Z_(?P<mission>{ID})")
_TIME = "%Y%m%dT%H%M%S"


def recording_id(started_ns: int, mission: str) -> str:
    """An id such as 20261125T143519250Z_m1. Ids sort by time, and are the files' names without the suffix."""
    started = datetime.fromtimestamp(started_ns // 10**9, UTC)
    return f"{started:{_TIME}}{started_ns // 10**6 % 1000:03d}Z_{mission}"


def parse_recording_id(id: str) -> tuple[int, str] | None:
    """(when it began [ns], mission) of an id; None if it isn't one, so that other files in the folder aren't touched."""
    match = _ID.fullmatch(id)
    if match is None:
        return None
    try:
        started = datetime.strptime(match["time"], _TIME).replace(tzinfo=UTC)
    except ValueError:
        return None
    return int(started.timestamp()) * 10**9 + int(match["ms"]) * 10**6, match["mission"]
