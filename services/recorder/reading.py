"""Reads recordings from front to back, as far as they go: one that was cut off has no end and no index."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator
from pathlib import Path

import zstandard
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Chunk, McapRecord, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk

from surveilnav.contract import ID
from surveilnav.errors import SurveilNavError

#: Names of the metadata written first (which mission it is of) and last (how the mission ended).
BEGIN, END = "mission", "end"
#: Larger records aren't the recorder's: a snapshot of a large building's maps has some hundred megabytes.
_MAX_RECORD_BYTES, _MAX_CHUNK_BYTES, _MAX_HEAD_BYTES = 1 << 30, 256 << 20, 1 << 20
#: Topics of a camera's views.
_CAMERA_TOPIC = re.compile(rf"/camera/({ID})/.*")
#: What the MCAP reader raises where bytes are missing or damaged.
_BROKEN = (McapError, OSError, ValueError, EOFError, struct.error, zstandard.ZstdError, OverflowError, MemoryError)


class RecordingError(SurveilNavError):
    """A file isn't a recording, or lacks what is asked of it."""


def records(path: Path) -> Iterator[McapRecord]:
    """The records of a file in order: schemas, channels, messages, attachments, metadata. Ends where the file is cut off.

    Raises:
        RecordingError: the file can't be opened, or isn't MCAP.
    """
    try:
        with path.open("rb") as file:
            if file.read(5) != b"\x89MCAP":
                raise RecordingError(f"expected a recording (.mcap), got {path}, which is something else")
            file.seek(0)
            yield from _until_damage(StreamReader(file, emit_chunks=True, record_size_limit=_MAX_RECORD_BYTES))
    except OSError as error:
        raise RecordingError(f"{path} can't be read: {error.strerror or error}") from error


def _until_damage(reader: StreamReader) -> Iterator[McapRecord]:
    unread = iter(reader.records)
    while True:
        try:
            record = next(unread)
            found = _records_of(record) if isinstance(record, Chunk) else [record]
        except StopIteration:
            return
        except _BROKEN:
            return
        yield from found


def _records_of(chunk: Chunk) -> list[McapRecord]:
    """The records of a chunk, after checking its checksum. Raises ValueError if it claims to be larger than any."""
    if chunk.uncompressed_size > _MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
    return breakup_chunk(chunk, validate_crc=True)


def target_of(path: Path) -> str:
    """The target of a recording's mission, from its first metadata; "" if it has none."""
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, record_size_limit=_MAX_HEAD_BYTES).records:
                if isinstance(record, Metadata):
                    return record.metadata.get("target", "")
    except _BROKEN:
        pass
    return ""


def cameras_of_complete(path: Path) -> list[str] | None:
    """The cameras that a recording shows; None if it wasn't written to the end of its mission."""
    try:
        with path.open("rb") as file:
            summary = SeekingReader(file, record_size_limit=_MAX_RECORD_BYTES).get_summary()
    except _BROKEN:
        return None
    if summary is None or not any(index.name == END for index in summary.metadata_indexes):
        return None
    shown = (_CAMERA_TOPIC.fullmatch(channel.topic) for channel in summary.channels.values())
    return sorted({match[1] for match in shown if match})
