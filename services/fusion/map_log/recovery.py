"""Reading the log back: the newest snapshot that can be read, and the views logged after it."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec

from surveilnav.bus import Node
from surveilnav.errors import WireError
from surveilnav.messages import FrameHeader, InferReply
from surveilnav.sensing.packing import decode_frame
from surveilnav.sensing.replies import perception_from_wire
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core.snapshot import SnapshotError, unpack
from surveilnav.services.fusion.map_log.store import Entry, Store
from surveilnav.services.fusion.perceived import PerceivedView

_HEADER = msgspec.msgpack.Decoder(FrameHeader)
_REPLY = msgspec.msgpack.Decoder(InferReply)


def restore_newest_snapshot(store: Store, node: Node, maps: BuildingMaps) -> None:
    """Restores the maps from the newest snapshot that can be read. Damaged ones are logged and skipped.

    If that leaves a gap before the log, the file is copied aside so that somebody may repair it, since the next snapshots will
    replace what it still holds.

    Raises:
        SnapshotError: the snapshot is of another version or of other settings. StoreError: the file can't be read.
    """
    damaged = []
    for up_to, data in store.snapshots():
        try:
            if data is None:
                raise SnapshotError("corrupt", "its bytes aren't those that were written")
            maps.restore(unpack(data))
            return
        except SnapshotError as error:
            if error.name != "corrupt":
                raise
            node.log.warning("snapshot_corrupt", up_to=up_to, error=str(error))
            damaged.append(up_to)
    first = next((number for number, _ in store.log(0)), 0 if damaged else 1)
    if first != 1 or 0 in damaged:
        aside = store.set_aside("snapshots_lost", copy=True)
        node.log.warning("snapshots_lost", log_begins_at=first, copied_to=str(aside))


def logged_views(store: Store, node: Node, after: int) -> Iterator[tuple[int, PerceivedView]]:
    """The views logged after number ``after``, with their numbers. Damaged and missing ones are reported. Raises StoreError."""
    for number, entry in store.log(after):
        if number > after + 1:
            node.log.warning("log_gap", after=after, next=number)
        after = number
        try:
            if entry is None:
                raise WireError("its bytes aren't those that were written")
            perceived = perceived_from_entry(entry)
        except Exception as error:
            node.log.warning("log_view_lost", number=number, error=f"{type(error).__name__}: {error}")
            continue
        yield number, perceived


def entry_from_perceived(p: PerceivedView) -> Entry:
    source, view = p.key
    return Entry(source, view, msgspec.msgpack.encode(p.header), bytes(p.payload), p.reply, p.digest, p.fault)


def perceived_from_entry(entry: Entry) -> PerceivedView:
    """The perceived view of a log entry. WireError, msgspec.DecodeError: it can't be decoded."""
    key, header = (entry.source, entry.view), _HEADER.decode(entry.header)
    if entry.fault or not entry.payload:
        return PerceivedView(key, header, fault=entry.fault)
    view = decode_frame(header, entry.payload)
    perception = perception_from_wire(_REPLY.decode(entry.reply), header.camera) if entry.reply else None
    return PerceivedView(key, header, view, perception, entry.payload, entry.reply, entry.digest)


def jpeg_of(entry: Entry, seq: int) -> bytes | None:
    """The JPEG of a logged view; None if its sequence number isn't ``seq``, or it has no JPEG."""
    header = _HEADER.decode(entry.header)
    if header.seq != seq or not entry.payload or header.image.encoding != "jpeg":
        return None
    return bytes(entry.payload[: header.image.n_bytes])
