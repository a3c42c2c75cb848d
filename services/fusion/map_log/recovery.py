"""Computing the maps from the file: from a snapshot and the views logged after it, without those that were removed."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import msgspec

from surveilnav.bus import Node
from surveilnav.errors import WireError
from surveilnav.messages import FrameHeader, InferReply
from surveilnav.sensing.packing import decode_frame, picture_jpeg
from surveilnav.sensing.replies import perception_from_wire
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core.snapshot import SnapshotError, unpack
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.map_log.store import Entry, Store
from surveilnav.services.fusion.perceived import PerceivedView

_HEADER = msgspec.msgpack.Decoder(FrameHeader)
_REPLY = msgspec.msgpack.Decoder(InferReply)


def has_clean_base(store: Store, removals: Sequence[Removal]) -> bool:
    """Whether the maps can be computed without what was removed, by what is known of the snapshots. Raises StoreError."""
    snapshots = list(store.snapshots())
    begins_empty = store.first_number() == 1 and not any(up_to == 0 for up_to, _, _ in snapshots)
    return begins_empty or any(contents.is_free_of(removals) for _, contents, _ in snapshots)


def restore_snapshot(store: Store, node: Node, maps: BuildingMaps, removals: Sequence[Removal]) -> list[Removal]:
    """Restores the maps from the newest snapshot that can be read and holds nothing of what was removed.

    If there is none, the empty maps take its place, provided that the log begins with them; else the newest snapshot that
    can be read, from which the removals by replay become removals by provenance.

    Damaged snapshots, and those of another version of the program, are logged and skipped. If that leaves a gap before the log,
    the file is copied aside so that somebody may repair it, or go back to the other version, since the next snapshots will
    replace what it still holds.

    Returns:
        The removals, each in the way in which it can be carried out.

    Raises:
        SnapshotError: the snapshot is of other settings. StoreError: the file can't be read.
    """
    damaged: list[int] = []
    unclean = []
    for up_to, contents, read in store.snapshots():
        if not contents.is_free_of(removals):
            unclean.append((up_to, read))
        elif _restore(maps, up_to, read, node):
            return list(removals)
        else:
            damaged.append(up_to)
    first = store.first_number()
    if unclean and (first != 1 or 0 in damaged or any(up_to == 0 for up_to, _ in unclean)):
        if any(_restore(maps, up_to, read, node) for up_to, read in unclean):
            node.log.warning("removed_by_provenance", log_begins_at=first)
            return [replace(r, way="provenance") for r in removals]
        damaged += [up_to for up_to, _ in unclean]
    if (first or (0 if damaged else 1)) != 1 or 0 in damaged:
        aside = store.set_aside("snapshots_lost", copy=True)
        node.log.warning("snapshots_lost", log_begins_at=first, copied_to=str(aside))
    return list(removals)


def _restore(maps: BuildingMaps, up_to: int, read: Callable[[], bytes | None], node: Node) -> bool:
    """Restores the maps from a snapshot; False if it is damaged or of another version. SnapshotError: of other settings."""
    try:
        data = read()
        if data is None:
            raise SnapshotError("corrupt", "its bytes aren't those that were written")
        maps.restore(unpack(data))
        return True
    except SnapshotError as error:
        if error.name not in ("corrupt", "other_version"):
            raise
        node.log.warning(f"snapshot_{error.name}", up_to=up_to, error=str(error))
        return False


def replay(
    store: Store,
    node: Node,
    maps: BuildingMaps,
    removals: Sequence[Removal],
    integrate: Callable[[int, PerceivedView], object],
    up_to: int | None = None,
) -> Iterator[int]:
    """Integrates the views that were logged after those that the maps hold, in their order, without those that were removed.

    A removal by provenance is repeated where it was carried out at first. So the maps become the same again.

    Args:
        removals: oldest first.
        up_to: log number of the last view; None: the end of the log.

    Yields:
        The number of each view that was processed.

    Raises:
        StoreError: the log can't be read.
    """
    pending = [r for r in removals if r.id > maps.removals]
    for number, entry in _entries(store, node, maps.number, up_to):
        pending = _reflect(node, maps, pending, number - 1)
        try:
            if entry is None:
                raise WireError("its bytes aren't those that were written")
            header = _HEADER.decode(entry.header)
            if any(r.way == "replay" and r.includes(entry.source, header.stamp_ns) for r in pending):
                maps.skip(header, number)
            else:
                integrate(number, perceived_from_entry(entry))
        except Exception as error:  # a view that ended the previous process must not end this one
            node.log.warning("log_view_lost", number=number, error=f"{type(error).__name__}: {error}")
        yield number
    maps.number = max(maps.number, up_to or 0)
    _reflect(node, maps, pending, maps.number if up_to is not None else None)


def _reflect(node: Node, maps: BuildingMaps, pending: list[Removal], number: int | None) -> list[Removal]:
    """Carries out the removals that were asked for when ``number`` (None: whatever) was the newest view; returns the others."""
    for k, removal in enumerate(pending):
        if number is not None and removal.number > number:
            return pending[k:]
        try:
            if removal.way == "provenance":
                maps.remove_by_provenance(removal)
        except Exception as error:  # fusion must start all the same
            node.log.warning("removal_lost", removal=removal.id, error=f"{type(error).__name__}: {error}")
        maps.update_quarantine(removal)
        maps.removals = removal.id
    return []


def _entries(store: Store, node: Node, after: int, up_to: int | None) -> Iterator[tuple[int, Entry | None]]:
    """The log after number ``after``, with the numbers; None for a damaged view. Gaps are reported. Raises StoreError."""
    for number, entry in store.log(after):
        if up_to is not None and number > up_to:
            return
        if number > after + 1:
            node.log.warning("log_gap", after=after, next=number)
        after = number
        yield number, entry


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
    """The picture of a logged view as JPEG; None if its sequence number isn't ``seq``, or it has none that can be read."""
    header = _HEADER.decode(entry.header)
    if header.seq != seq or not entry.payload:
        return None
    try:
        return picture_jpeg(header, entry.payload)
    except WireError:
        return None
