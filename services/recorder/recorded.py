"""The contents of a recording, in order: maps to start from, the messages of the bus, and how the mission ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema

from surveilnav.contract import Stream
from surveilnav.messages.recording import ONLY_FUSION
from surveilnav.services.recorder.core.mcap_message import BUS_ENCODING, decode_bus_message, stream_of_topic
from surveilnav.services.recorder.intact import Damage
from surveilnav.services.recorder.reading import BEGIN, END, RecordingError, records


@dataclass(frozen=True, slots=True, eq=False)
class RecordedStart:
    """What a recording is of: mission, target, robot, building, prompt."""

    facts: dict[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMaps:
    """A snapshot of fusion's maps after view ``number`` of its log.

    Attributes:
        config: fusion's settings as JSON.
        fusion: the fusion service whose maps they are.
    """

    number: int
    config: str
    snapshot: bytes
    fusion: str = ONLY_FUSION


@dataclass(frozen=True, slots=True, eq=False)
class RecordedMessage:
    """A message of the bus, its key and the ids in it. ``log_ns``: when the recorder received it."""

    stream: Stream
    key: str
    ids: dict[str, str]
    message: Any
    payload: bytes
    log_ns: int


@dataclass(frozen=True, slots=True, eq=False)
class RecordedEnd:
    """How the mission ended; and number, revision and digest of the final maps, if the recording has all their views.

    Those of one of several fusion services are found by ``core.facts.fact_name``.
    """

    facts: dict[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class RecordedDamage:
    """A part of the file that can't be read, and when its messages were recorded [ns]; 0 if that is unknown."""

    n_bytes: int
    start_ns: int
    end_ns: int


RecordedItem = RecordedStart | RecordedMaps | RecordedMessage | RecordedEnd | RecordedDamage


def read_recording(path: Path) -> Iterator[RecordedItem]:
    """The contents of a recording in order, as far as the file goes, and the damages in between.

    Raises:
        RecordingError: the file isn't a recording of this program.
    """
    reader, is_recording = _Reader(), False
    for record in records(path):
        item = reader.read(record)
        if item is not None:
            is_recording |= not isinstance(item, RecordedDamage)
            yield item
    if not is_recording:
        raise RecordingError(f"{path} holds no mission: expected a file that `surveilnav.services.recorder` wrote")


@dataclass
class _Reader:
    """Makes items of a file's records, for which it remembers schemas, channels and metadata."""

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, tuple[Stream, str, dict[str, str]]] = field(default_factory=dict)
    facts: dict[str, dict[str, str]] = field(default_factory=dict)

    def read(self, record: McapRecord | Damage) -> RecordedItem | None:
        """The item that a record holds, if any. Raises RecordingError if it can't be read."""
        match record:
            case Damage():
                return RecordedDamage(record.n_bytes, record.start_ns, record.end_ns)
            case Schema():
                self.schemas[record.id] = record.name
            case Channel() if record.message_encoding == BUS_ENCODING:
                self._add_channel(record)
            case Message() if record.channel_id in self.channels:
                return self._message(record)
            case Metadata():
                self.facts[record.name] = record.metadata
                if record.name in (BEGIN, END):
                    return (RecordedStart if record.name == BEGIN else RecordedEnd)(record.metadata)
            case Attachment() if record.name in self.facts:
                return self._maps(record)
        return None

    def _add_channel(self, channel: Channel) -> None:
        stream = stream_of_topic(self.schemas.get(channel.schema_id, ""), channel.topic)
        ids = stream.ids_of(channel.topic) if stream else None
        if stream is not None and ids is not None:
            self.channels[channel.id] = stream, channel.topic, ids

    def _message(self, record: Message) -> RecordedMessage:
        stream, key, ids = self.channels[record.channel_id]
        try:
            message, payload = decode_bus_message(stream, record.data)
        except (msgspec.DecodeError, ValueError, TypeError, OverflowError, RecursionError) as error:
            raise RecordingError(f"a message of {key} can't be read: {error}") from error
        return RecordedMessage(stream, key, ids, message, payload, record.log_time)

    def _maps(self, record: Attachment) -> RecordedMaps:
        number = record.name.rpartition("-")[2]
        if not number.isdigit():
            raise RecordingError(f"expected maps-NUMBER, got an attachment {record.name!r:.80}")
        facts = self.facts[record.name]
        return RecordedMaps(int(number), facts.get("config", ""), record.data, facts.get("fusion", ONLY_FUSION))
