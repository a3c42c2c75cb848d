"""The joint maps, what they hold of whom, and the file that both outlive the process in.

A view is logged before the maps take it, so whatever a revision or a reply says can be made again: the newest snapshot
that can be read, and the views logged since, in their order. A disk that won't be written holds views up: they wait,
nothing is acknowledged, and ``problem`` says why. A file that is begun anew takes views only after a snapshot of the maps.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from services.fusion.config import FusionSettings
from services.fusion.core import JointMap
from services.fusion.core.guard import ViewError
from services.fusion.core.map_object import ObjectChange
from services.fusion.core.snapshot import SnapshotError, freeze, pack, thaw, unpack
from services.fusion.perceiver import Perceived, ViewKey
from services.fusion.store import Entry, Store, StoredEvent, StoreError
from surveilnav.bus import Node
from surveilnav.errors import WireError
from surveilnav.messages import FrameHeader, InferReply
from surveilnav.messages.maps import ObjectEvent
from surveilnav.sensing.packing import decode_frame, perception_from_wire

_HEADER = msgspec.msgpack.Decoder(FrameHeader)
_REPLY = msgspec.msgpack.Decoder(InferReply)
_ROW_BYTES = 1024  # of a view in the log, beside its picture: about
_PLACE_UNKNOWN = {"bad_pose", "pose_jump", "time_backwards", "out_of_map"}


@dataclass(frozen=True, slots=True)
class HeldRobot:
    """The newest observation of a robot that the maps hold, or refused, and on which storey."""

    floor: str
    seq: int
    stamp_ns: int


class Keeper:
    """Views in by ``take``. ``lock`` guards ``joint``; the rest belongs to the loop that calls ``take``.

    Attributes:
        robots: newest observation by robot.
        views: views in the maps by camera, refused ones too: nobody should wait for them for ever.
        digests: of the cameras' views that the maps took; one dictionary, for whoever must not ask about them again.
        troubles: why the newest picture of a view was refused, by source and view.
        problem: why views can't be logged now; empty while they can.
    """

    def __init__(self, node: Node, settings: FusionSettings) -> None:
        self._node, self._settings = node, settings
        self.joint = JointMap(settings.core())
        self.lock = threading.Lock()
        self.robots: dict[str, HeldRobot] = {}
        self.views: dict[str, set[int]] = {}
        self.digests: dict[ViewKey, bytes] = {}
        self.troubles: dict[ViewKey, str] = {}
        self.problem = ""
        self._store = Store(Path(settings.store), max_events=settings.max_events) if settings.store else None
        self._waiting: dict[ViewKey, Perceived] = {}
        self._events: list[StoredEvent] = []
        self._number = 0  # of the newest view taken, in the log
        self._logged = (0, 0)  # views taken and bytes logged since the last snapshot
        self._again_s = 0.0
        self._saving: threading.Thread | None = None
        self._restored = False
        self._bare = False  # the file is new and lacks what the maps hold
        self._ready()

    @property
    def held_up(self) -> bool:
        """Whether views wait for the file: no more should be brought."""
        return bool(self._waiting and self.problem)

    def take(self, arrived: Iterable[Perceived]) -> None:
        """Logs views, has the maps take them in their canonical order, and saves a snapshot if one is due."""
        for perceived in arrived:
            if self._is_news(perceived):
                self._waiting[perceived.key] = perceived
        if self._waiting and time.monotonic() >= self._again_s and self._ready():
            batch = sorted(self._waiting.values(), key=lambda p: (p.header.stamp_ns, p.key))
            if (numbers := self._log(batch)) is not None:
                self._waiting.clear()
                for number, perceived in zip(numbers, batch, strict=True):
                    self._take(number, perceived)
                self._write_events()
        if self._due():
            self._snapshot()

    def history(self, floor: str, object_id: int) -> list[ObjectEvent] | None:
        """Everything that ever happened to an object; None without a store. StoreError: it can't be read."""
        return None if self._store is None else self._store.history(floor, object_id)

    def close(self) -> None:
        """Ends a snapshot that is being written, and closes the file."""
        self._end_saving()
        if self._store is not None:
            self._store.close()

    # --- views ----------------------------------------------------------------------------------------------------

    def _is_news(self, perceived: Perceived) -> bool:
        """Whether a view must be logged: not a camera's that the maps took, nor a fault that it had before."""
        key, fault = perceived.key, perceived.fault
        if fault and key[0].startswith("camera/") and self.troubles.get(key) == _trouble(perceived, fault):
            self._node.reject(f"view.{fault.partition(':')[0]}", f"{key[0]} view {key[1]}: {fault}")
            return False
        held = bool(perceived.digest) and key[0].startswith("camera/") and self.digests.get(key) == perceived.digest
        return bool(fault) or (perceived.view is not None and not held)

    def _take(self, number: int, perceived: Perceived, *, again: bool = False) -> None:
        """Has the maps take a view. ``again``: after a restart, when what is wrong with it was said before."""
        source, view = perceived.key
        refused, floor, done = perceived.fault, "", None
        events: tuple[ObjectChange, ...] = ()
        if perceived.view is not None:
            try:
                missed = self.joint.guard.missed.get(source, 0)
                with self.lock:
                    done = self.joint.accept(perceived.view, perceived.perception)
                floor, events = (done.floor, done.changes) if done else ("", ())
                if not again and (gap := self.joint.guard.missed.get(source, 0) - missed):
                    self._node.reject("view.missing_seq", f"{source} skipped {gap} before {perceived.header.seq}")
            except ViewError as error:
                refused, floor = str(error), self._floor_of(perceived, error.name)
        if refused and not again:
            self._node.reject(f"view.{refused.partition(':')[0]}", f"{source} view {view}: {refused}")
        self._note(perceived, floor, refused, taken=done is not None)
        self._number = number
        # what was refused buys no snapshot, but its bytes do: the log is bounded
        views, n_bytes = self._logged
        self._logged = views + (done is not None), n_bytes + len(perceived.payload) + _ROW_BYTES
        if self._store is not None:
            self._events += [_stored(number, k, floor, happened) for k, happened in enumerate(events)]

    def _note(self, perceived: Perceived, floor: str, refused: str, *, taken: bool) -> None:
        """What the maps now hold; a refused view counts as held, empty."""
        kind, _, name = perceived.key[0].partition("/")
        header = perceived.header
        if kind == "robot":
            known = self.robots.get(name)
            floor = floor or (known.floor if known else header.floor)
            self.robots[name] = HeldRobot(floor, header.seq, header.stamp_ns)
        else:
            self.views.setdefault(name, set()).add(perceived.key[1])
            if taken and perceived.digest:
                self.digests[perceived.key] = perceived.digest
        self.troubles.pop(perceived.key, None)
        if refused:
            self.troubles[perceived.key] = _trouble(perceived, refused)

    def _floor_of(self, perceived: Perceived, fault: str) -> str:
        """The storey that a refused view was taken on, "" if unknown."""
        if fault in _PLACE_UNKNOWN or perceived.view is None:
            return ""
        with self.lock:
            return self.joint.floor_at(perceived.view.floor_z_m)

    # --- the file -------------------------------------------------------------------------------------------------

    def _ready(self) -> bool:
        """Whether everything that was held before the last restart is held again, by the maps and by the file."""
        if self._store is None:
            return True
        self._restored = self._restored or self._restore(self._store)
        return self._restored and self._furnished(self._store)

    def _log(self, batch: list[Perceived]) -> list[int] | None:
        """Commits views; returns their numbers, or None if that can't be done now."""
        if self._store is None:
            return [self._number + 1 + i for i in range(len(batch))]
        try:
            numbers = self._store.append([_entry(p) for p in batch])
        except StoreError as error:
            self._hold_up(error)
            if error.name == "corrupt":
                self._begin_anew(self._store, error.name, str(error))
            return None
        self.problem = ""
        return numbers

    def _hold_up(self, error: StoreError) -> None:
        self.problem = f"views wait, the store can't be written: {error}"
        self._again_s = time.monotonic() + self._settings.retry_s
        self._node.warn_seldom("the store can't be written", error=str(error))

    def _write_events(self) -> None:
        if not self._events or self._store is None:
            return
        try:
            self._store.add_events(self._events)
            self._events = []
        except StoreError as error:  # they wait; whatever happens, the views that made them are logged
            self._node.warn_seldom("events can't be written", error=str(error))

    def _due(self) -> bool:
        views, n_bytes = self._logged
        enough = views >= self._settings.snapshot_views or n_bytes >= self._settings.snapshot_mb << 20
        busy = self._saving is not None and self._saving.is_alive()
        safe = self._store is not None and self._restored and not self._bare
        return enough and safe and not busy and not self._events

    def _snapshot(self) -> None:
        """Copies the maps now and saves them beside the loop."""
        self._saving = threading.Thread(
            target=self._save, args=(self._frozen(), self._number), name="snapshot", daemon=True
        )
        self._saving.start()

    def _frozen(self) -> dict[str, Any]:
        with self.lock:
            maps = freeze(self.joint)
        held = {
            "robots": {name: [r.floor, r.seq, r.stamp_ns] for name, r in self.robots.items()},
            "views": {name: sorted(views) for name, views in self.views.items()},
            "digests": [[*key, digest] for key, digest in self.digests.items()],
            "troubles": [[*key, why] for key, why in self.troubles.items()],
        }
        self._logged = 0, 0
        return {"maps": maps, "held": held}

    def _save(self, state: dict[str, Any], up_to: int) -> None:
        assert self._store is not None
        try:
            self._store.save(pack(state), up_to)
        except Exception as error:  # the log goes on from the one before
            self._node.warn_seldom("a snapshot can't be written", error=f"{type(error).__name__}: {error}")

    def _end_saving(self) -> None:
        if self._saving is not None:
            self._saving.join()

    def _restore(self, store: Store) -> bool:
        """Takes up what the file holds; False: it can't be read now. What can't be used is said and set aside."""
        began_s, name, message = time.monotonic(), "", ""
        try:
            self._load(store)
            self._replay(store)
        except SnapshotError as error:
            name, message = error.name, str(error)
        except StoreError as error:
            if error.name == "unwritable":
                self._hold_up(error)
                return False
            name, message = error.name, str(error)
        if name and not self._begin_anew(store, name, message):
            return False
        if self.joint.revision:
            seconds = round(time.monotonic() - began_s, 2)
            self._node.log.info("restored", revision=self.joint.revision, seconds=seconds)
        return True

    def _begin_anew(self, store: Store, name: str, message: str) -> bool:
        """Sets a file aside that is of no use any more; the maps go into the new one before any view."""
        self._end_saving()  # into the old file
        try:
            aside = store.set_aside(name)
        except StoreError as error:
            self._hold_up(error)
            return False
        self._node.log.warning(f"store_{name}", error=message, moved_to=str(aside), revision=self.joint.revision)
        self._number = 0
        self._bare = bool(self.joint.revision or self.robots or self.views)
        return True

    def _furnished(self, store: Store) -> bool:
        """Whether the file holds what the maps held when it was begun anew."""
        if self._bare:
            try:
                store.save(pack(self._frozen()), 0)
            except StoreError as error:
                self._hold_up(error)
                return False
            self._bare = False
        return True

    def _load(self, store: Store) -> None:
        """The newest snapshot that can be read."""
        damaged = []
        for up_to, data in store.snapshots():
            try:
                if data is None:
                    raise SnapshotError("corrupt", "its bytes aren't those that were written")
                state = unpack(data)
                joint = thaw(state["maps"], self.joint.config)
                with self.lock:
                    self.joint = joint
                held = state["held"]
                self.robots = {name: HeldRobot(*fields) for name, fields in held["robots"].items()}
                self.views = {name: set(views) for name, views in held["views"].items()}
                self.digests.clear()
                self.digests.update({(source, view): digest for source, view, digest in held["digests"]})
                self.troubles = {(source, view): why for source, view, why in held["troubles"]}
                self._number = up_to
                return
            except SnapshotError as error:
                if error.name != "corrupt":
                    raise
                self._node.log.warning("snapshot_corrupt", up_to=up_to, error=str(error))
                damaged.append(up_to)
        first = next((number for number, _ in store.log(0)), 0 if damaged else 1)
        if first != 1 or 0 in damaged:  # the next snapshots take the place of what somebody may still repair
            aside = store.set_aside("snapshots_lost", copy=True)
            self._node.log.warning("snapshots_lost", log_begins_at=first, copied_to=str(aside))

    def _replay(self, store: Store) -> None:
        """The views logged since."""
        after = self._number
        for number, entry in store.log(after):
            if number > after + 1:
                self._node.log.warning("log_gap", after=after, next=number)
            after = number
            try:
                if entry is None:
                    raise WireError("its bytes aren't those that were written")
                self._take(number, _perceived(entry), again=True)
            except Exception as error:  # a view that ended the last process must not end this one, too
                self._node.log.warning("log_view_lost", number=number, error=f"{type(error).__name__}: {error}")
        self._write_events()


def _entry(p: Perceived) -> Entry:
    source, view = p.key
    return Entry(source, view, msgspec.msgpack.encode(p.header), bytes(p.payload), p.reply, p.digest, p.fault)


def _perceived(entry: Entry) -> Perceived:
    """What was logged. WireError, msgspec.DecodeError: it can't be read."""
    key, header = (entry.source, entry.view), _HEADER.decode(entry.header)
    if entry.fault or not entry.payload:
        return Perceived(key, header, fault=entry.fault)
    view = decode_frame(header, entry.payload)
    perception = perception_from_wire(_REPLY.decode(entry.reply), header.camera) if entry.reply else None
    return Perceived(key, header, view, perception, entry.payload, entry.reply, entry.digest)


def _trouble(perceived: Perceived, fault: str) -> str:
    source, view = perceived.key
    which = perceived.header.seq if source.startswith("robot/") else view
    return f"view {which} of {source} was refused: {fault}"


def _stored(number: int, k: int, floor: str, happened: ObjectChange) -> StoredEvent:
    return StoredEvent(number, k, floor, happened.object_id, happened.absorbed, happened.event)
