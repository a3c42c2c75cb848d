"""Reads what is whole of a damaged MCAP file: skips damaged records, by the index where their lengths are damaged."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Chunk, ChunkIndex, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk

#: What the MCAP reader raises where bytes are missing or damaged.
BROKEN = (McapError, OSError, ValueError, EOFError, struct.error, zstandard.ZstdError, OverflowError, MemoryError)
#: Larger records aren't the recorder's: a snapshot of a large building's maps has some hundred megabytes.
MAX_RECORD_BYTES, _MAX_CHUNK_BYTES = 1 << 30, 256 << 20
_MAGIC_BYTES, _HEAD = 8, struct.Struct("<BQ")  # of a record: kind and length
_FOOTER = struct.Struct("<BQQQI")  # kind, length, where the summary and its offsets begin, the checksum of the summary
_PLAYED = {Opcode.CHUNK, Opcode.ATTACHMENT, Opcode.METADATA}


@dataclass(frozen=True, slots=True)
class Damage:
    """A part of a file that can't be read.

    Attributes:
        offset, n_bytes: where it lies.
        start_ns, end_ns: when the messages in it were recorded; 0 if unknown.
    """

    offset: int
    n_bytes: int
    start_ns: int = 0
    end_ns: int = 0


@dataclass(frozen=True, slots=True)
class _Index:
    """Where records begin, by the summary at the end of the file; and its schemas and channels."""

    records: dict[int, tuple[int, int]] = field(default_factory=dict)  # by offset: kind, and length with its head
    chunks: dict[int, ChunkIndex] = field(default_factory=dict)
    declared: tuple[McapRecord, ...] = ()


def intact_records(file: BinaryIO) -> Iterator[McapRecord | Damage]:
    """The whole records of a file in order, chunks opened, and the damages between them.

    By the index it finds everything that is whole. A file that was cut off has none: there it goes by the lengths of the
    records, up to one that can't be. Schemas and channels that a damaged chunk may have declared are repeated from the index.
    """
    index = _read_index(file)
    yield from _by_index(file, index) if index.records else _by_lengths(file)


def _by_index(file: BinaryIO, index: _Index) -> Iterator[McapRecord | Damage]:
    for offset, (kind, length) in sorted(index.records.items()):
        try:
            yield from _read_record(file, offset, kind, length - _HEAD.size)
        except BROKEN:
            chunk = index.chunks.get(offset)
            yield Damage(offset, length, *((chunk.message_start_time, chunk.message_end_time) if chunk else ()))
            yield from index.declared


def _by_lengths(file: BinaryIO) -> Iterator[McapRecord | Damage]:
    size, at = file.seek(0, io.SEEK_END), _MAGIC_BYTES
    while at + _HEAD.size <= size:
        file.seek(at)
        kind, length = _HEAD.unpack(file.read(_HEAD.size))
        end = at + _HEAD.size + length
        if end > size or length > MAX_RECORD_BYTES or kind == Opcode.DATA_END:
            return
        try:
            if kind in _PLAYED:
                yield from _read_record(file, at, kind, length)
        except BROKEN:
            yield Damage(at, end - at)
        at = end


def _read_record(file: BinaryIO, at: int, kind: int, length: int) -> list[McapRecord]:
    """The record at an offset, of a kind and a length without its head; of a chunk those in it. Raises one of ``BROKEN``."""
    file.seek(at + _HEAD.size)
    body = file.read(length)
    if kind == Opcode.ATTACHMENT and zlib.crc32(body[:-4]) != int.from_bytes(body[-4:], "little"):
        raise ValueError("an attachment's checksum")
    stream = io.BytesIO(_HEAD.pack(kind, length) + body)
    reader = StreamReader(stream, skip_magic=True, emit_chunks=True, record_size_limit=MAX_RECORD_BYTES)
    record = next(iter(reader.records))
    if not isinstance(record, Chunk):
        return [record]
    if record.uncompressed_size > _MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
    return breakup_chunk(record, validate_crc=True)


def _read_index(file: BinaryIO) -> _Index:
    """The index of a file; an empty one if it has none, or a damaged one."""
    try:
        size = file.seek(0, io.SEEK_END)
        begin = size - _MAGIC_BYTES - _FOOTER.size
        file.seek(begin)
        _, _, summary_begin, _, checksum = _FOOTER.unpack(file.read(_FOOTER.size))
        file.seek(summary_begin)
        covered = file.read(begin + _FOOTER.size - 4 - summary_begin)
        if not summary_begin or zlib.crc32(covered) != checksum:
            return _Index()
        file.seek(0)
        summary = SeekingReader(file, record_size_limit=MAX_RECORD_BYTES).get_summary()
    except BROKEN:
        return _Index()
    if summary is None:
        return _Index()
    chunks = {chunk.chunk_start_offset: chunk for chunk in summary.chunk_indexes}
    entries = {offset: (int(Opcode.CHUNK), chunk.chunk_length) for offset, chunk in chunks.items()}
    entries |= {entry.offset: (int(Opcode.ATTACHMENT), entry.length) for entry in summary.attachment_indexes}
    entries |= {entry.offset: (int(Opcode.METADATA), entry.length) for entry in summary.metadata_indexes}
    return _Index(entries, chunks, (*summary.schemas.values(), *summary.channels.values()))
