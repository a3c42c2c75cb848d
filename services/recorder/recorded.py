"""What a recording tells, in order: maps to start from, what went over the bus, and how it ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from surveilnav.contract import Stream
from surveilnav.services.recorder.core.line import BUS_ENCODING, read_bus_line, stream_of
from surveilnav.services.recorder.reading import BEGIN, END, RecordingError, records


@dataclass(frozen=True, slots=True, eq=False)
class Begin:
    """What a recording is of: mission, target, robot, building, prompt."""

    facts: dict[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Maps:
    """Fusion's maps after view ``number`` of its log, as a snapshot; made with ``config`` (JSON)."""

    number: int
    config: str
    snapshot: bytes


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """A message of the bus on its key."""

    stream: Stream
    key: str
    ids: dict[str, str]
    message: Any
    payload: bytes
    log_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class End:
    """How the mission ended, and what the maps came to."""

    facts: dict[str, str]


Told = Begin | Maps | Heard | End


@dataclass
class _Reader:
    """Puts the records of a file together."""

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, tuple[Stream, str, dict[str, str]]] = field(default_factory=dict)
    facts: dict[str, dict[str, str]] = field(default_factory=dict)

    def told(self, record: McapRecord) -> Told | None:
        """What a record tells, if anything. RecordingError: it can't be what it says it is."""
        match record:
            case Schema():
                self.schemas[record.id] = record.name
            case Channel() if record.message_encoding == BUS_ENCODING:
                self._note(record)
            case Message() if record.channel_id in self.channels:
                return self._heard(record)
            case Metadata():
                self.facts[record.name] = record.metadata
                if record.name in (BEGIN, END):
                    return (Begin if record.name == BEGIN else End)(record.metadata)
            case Attachment() if record.name in self.facts:
                return self._maps(record)
        return None

    def _note(self, channel: Channel) -> None:
        stream = stream_of(self.schemas.get(channel.schema_id, ""), channel.topic)
        ids = stream.ids_of(channel.topic) if stream else None
        if stream is not None and ids is not None:
            self.channels[channel.id] = stream, channel.topic, ids

    def _heard(self, record: Message) -> Heard:
        stream, key, ids = self.channels[record.channel_id]
        try:
            message, payload = read_bus_line(stream, record.data)
        except (msgspec.DecodeError, ValueError, TypeError, OverflowError, RecursionError) as error:
            raise RecordingError(f"a message of {key} can't be read: {error}") from error
        return Heard(stream, key, ids, message, payload, record.log_time)

    def _maps(self, record: Attachment) -> Maps:
        number = record.name.rpartition("-")[2]
        if not number.isdigit():
            raise RecordingError(f"expected maps-NUMBER, got an attachment {record.name!r:.80}")
        return Maps(int(number), self.facts[record.name].get("config", ""), record.data)


def told(path: Path) -> Iterator[Told]:
    """What a recording tells, as far as it goes.

    Raises:
        RecordingError: it is no recording of this program.
    """
    reader, any_told = _Reader(), False
    for record in records(path):
        found = reader.told(record)
        if found is not None:
            any_told = True
            yield found
    if not any_told:
        raise RecordingError(f"{path} holds no mission: expected a file that `surveilnav.services.recorder` wrote")
