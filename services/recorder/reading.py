"""Recordings read from front to back, as far as they go: one that was cut off has neither end nor index."""

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

#: Facts about a recording: what it is of, written first; how it ended, written last.
BEGIN, END = "mission", "end"
#: What is larger was written by nobody here: a snapshot of a large building's maps has some hundred megabytes.
_MOST_RECORD_BYTES, _MOST_CHUNK_BYTES, _MOST_HEAD_BYTES = 1 << 30, 256 << 20, 1 << 20
#: Topics that a view of a camera is drawn on.
_PICTURE = re.compile(rf"/camera/({ID})/.*")
#: What the reader raises where bytes are missing or damaged.
_BROKEN = (McapError, OSError, ValueError, EOFError, struct.error, zstandard.ZstdError, OverflowError, MemoryError)


class RecordingError(SurveilNavError):
    """A file that is no recording, or lacks what is asked of it."""


def records(path: Path) -> Iterator[McapRecord]:
    """What the file holds, in order: schemas, channels, messages, attachments, facts. It ends where the file is cut off.

    Raises:
        RecordingError: it can't be opened, or isn't MCAP.
    """
    try:
        with path.open("rb") as file:
            if file.read(5) != b"\x89MCAP":
                raise RecordingError(f"expected a recording (.mcap), got {path}, which is something else")
            file.seek(0)
            yield from _until_damage(StreamReader(file, emit_chunks=True, record_size_limit=_MOST_RECORD_BYTES))
    except OSError as error:
        raise RecordingError(f"{path} can't be read: {error.strerror or error}") from error


def _until_damage(reader: StreamReader) -> Iterator[McapRecord]:
    found = iter(reader.records)
    while True:
        try:
            record = next(found)
            inside = _inside(record) if isinstance(record, Chunk) else [record]
        except StopIteration:
            return
        except _BROKEN:
            return
        yield from inside


def _inside(chunk: Chunk) -> list[McapRecord]:
    """The records of a chunk, its checksum checked. ValueError: it says that it is larger than any."""
    if chunk.uncompressed_size > _MOST_CHUNK_BYTES:
        raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
    return breakup_chunk(chunk, validate_crc=True)


def target_of(path: Path) -> str:
    """What a recording's mission looks for, as its first facts say; "" if it has none."""
    try:
        with path.open("rb") as file:
            for record in StreamReader(file, record_size_limit=_MOST_HEAD_BYTES).records:
                if isinstance(record, Metadata):
                    return record.metadata.get("target", "")
    except _BROKEN:
        pass
    return ""


def cameras_in_whole(path: Path) -> list[str] | None:
    """The cameras that a recording shows; None for one that wasn't written to the end of its mission."""
    try:
        with path.open("rb") as file:
            summary = SeekingReader(file, record_size_limit=_MOST_RECORD_BYTES).get_summary()
    except _BROKEN:
        return None
    if summary is None or not any(index.name == END for index in summary.metadata_indexes):
        return None
    shown = (_PICTURE.fullmatch(channel.topic) for channel in summary.channels.values())
    return sorted({match[1] for match in shown if match})
