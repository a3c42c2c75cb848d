"""Reads recordings from front to back: what is whole of them. One that was cut off has no end and no index."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from mcap.reader import SeekingReader
from mcap.records import McapRecord, Metadata
from mcap.stream_reader import StreamReader

from surveilnav.contract import ID
from surveilnav.errors import SurveilNavError
from surveilnav.services.recorder.intact import BROKEN, MAX_RECORD_BYTES, Damage, intact_records

#: Names of the metadata written first (which mission it is of) and last (how the mission ended).
BEGIN, END = "mission", "end"
_MAX_HEAD_BYTES = 1 << 20
#: Topics of a camera's views.
_CAMERA_TOPIC = re.compile(rf"/camera/({ID})/.*")


class RecordingError(SurveilNavError):
    """A file isn't a recording, or lacks what is asked of it."""


def records(path: Path) -> Iterator[McapRecord | Damage]:
    """The records of a file in order: schemas, channels, messages, attachments, metadata; and what is damaged between them.

    It ends where the file is cut off.

    Raises:
        RecordingError: the file can't be opened, or isn't MCAP.
    """
    try:
        with path.open("rb") as file:
            if file.read(5) != b"\x89MCAP":
                raise RecordingError(f"expected a recording (.mcap), got {path}, which is something else")
            yield from intact_records(file)
    except OSError as error:
        raise RecordingError(f"{path} can't be read: {error.strerror or error}") from error


def target_of(path: Path) -> str:
    """The target of a recording's mission, from its first metadata; "" if it has none."""
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, record_size_limit=_MAX_HEAD_BYTES).records:
                if isinstance(record, Metadata):
                    return record.metadata.get("target", "")
    except BROKEN:
        pass
    return ""


def cameras_of_complete(path: Path) -> list[str] | None:
    """The cameras that a recording shows; None if it wasn't written to the end of its mission."""
    try:
        with path.open("rb") as file:
            summary = SeekingReader(file, record_size_limit=MAX_RECORD_BYTES).get_summary()
    except BROKEN:
        return None
    if summary is None or not any(index.name == END for index in summary.metadata_indexes):
        return None
    shown = (_CAMERA_TOPIC.fullmatch(channel.topic) for channel in summary.channels.values())
    return sorted({match[1] for match in shown if match})
