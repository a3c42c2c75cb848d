"""The joint maps, and the file that they outlive the process in.

A disk that won't be written blocks views: they wait, nothing is acknowledged, and ``problem`` says why. A file that is
begun anew takes views only after a snapshot of the maps.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable

from surveilnav.bus import Node
from surveilnav.messages.maps import ObjectEvent
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.fusion.core.objects.map_object import ObjectChange
from surveilnav.services.fusion.core.snapshot import SnapshotError, freeze, thaw
from surveilnav.services.fusion.core.views.validation import ViewError
from surveilnav.services.fusion.map_log.journal import Journal, State
from surveilnav.services.fusion.map_log.store import Entry, StoreError
from surveilnav.services.fusion.processed import MapContents
from surveilnav.services.fusion.records import PerceivedView, ViewKey

_PLACE_UNKNOWN = {"bad_pose", "pose_jump", "time_backwards", "out_of_map"}


class DurableMap:
    """Views in by ``take``. ``lock`` guards ``joint``; the rest belongs to the loop that calls ``take``.

    Attributes:
        joint: the joint maps.
        contents: what they have processed of whom.
    """

    def __init__(self, node: Node, settings: FusionSettings, keep_pictures_s: float | None = None) -> None:
        """``keep_pictures_s``: how long pictures may stay in the file; None: as long as the log needs them."""
        self._node = node
        self.joint = JointMap(settings.core())
        self.lock = threading.Lock()
        self._whole = threading.Lock()  # maps, contents and the log's number belong together
        self.contents = MapContents()
        self._journal = Journal(node, settings, keep_pictures_s) if settings.store else None
        self._waiting: dict[ViewKey, PerceivedView] = {}
        self._restored = self._journal is None
        self._lacks_maps = False  # the file is new and lacks what the maps hold
        self._make_ready()

    @property
    def problem(self) -> str:
        """Why views can't be logged now; empty while they can."""
        return self._journal.problem if self._journal else ""

    @property
    def store_blocked(self) -> bool:
        """Whether views wait for the file: no more should be brought."""
        return bool(self._waiting and self.problem)

    def holds(self, key: ViewKey, digest: bytes) -> bool:
        """Whether the maps hold this very picture of a camera: nobody must look at it again. From any thread."""
        return self.contents.holds(key, digest)

    def take(self, arrived: Iterable[PerceivedView]) -> None:
        """Logs views, has the maps take them in order, and saves a snapshot if one is due."""
        for perceived in arrived:
            if self._is_news(perceived):
                self._waiting[perceived.key] = perceived
        rests = self._journal is not None and self._journal.rests
        if self._waiting and not rests and self._make_ready():
            self._take_waiting()
        if self._journal is not None and self._restored and not self._lacks_maps:
            if self._journal.snapshot_is_due:
                self._journal.save(self._frozen())
            self._journal.drop_old()

    def forget_pictures(self) -> bool:
        """Has all pictures leave the file, within seconds; False: there is no file. From any thread."""
        if self._journal is not None:
            self._journal.forget_pictures()
        return self._journal is not None

    def history(self, floor: str, object_id: int) -> list[ObjectEvent] | None:
        """Everything that ever happened to an object; None without a store. StoreError: it can't be read."""
        return None if self._journal is None else self._journal.history(floor, object_id)

    def picture(self, source: str, view: int, seq: int) -> bytes | None:
        """The JPEG of a view that the log has still; None without a store. StoreError: it can't be read."""
        return None if self._journal is None else self._journal.picture(source, view, seq)

    def logged_after(self, number: int) -> tuple[int, tuple[int, Entry] | None]:
        """The number of the newest view taken, and the first that the log has after one, with its number; None: there is none
        yet. From any thread. StoreError: it can't be read, or there is no log."""
        if self._journal is None:
            raise StoreError("no_log", "fusion keeps no log of views: set SURVEILNAV_FUSION__STORE")
        return self._journal.number, self._journal.after(number)

    def frozen(self) -> tuple[int, State]:
        """A copy of the maps and of what they have processed, and the number of the view that they took last. From any
        thread."""
        with self._whole:
            return (self._journal.number if self._journal else 0), self._frozen()

    def close(self) -> None:
        """Ends a snapshot that is being written, and closes the file."""
        if self._journal is not None:
            self._journal.close()

    # --- views ----------------------------------------------------------------------------------------------------

    def _is_news(self, perceived: PerceivedView) -> bool:
        """Whether a view must be logged: not a camera's that the maps hold, nor a fault that it had before."""
        key, fault = perceived.key, perceived.fault
        if self.contents.repeats_fault(perceived):
            self._node.reject(f"view.{fault.partition(':')[0]}", f"{key[0]} view {key[1]}: {fault}")
            return False
        return bool(fault) or (perceived.view is not None and not self.contents.holds(key, perceived.digest))

    def _take_waiting(self) -> None:
        """Logs what waits, then has the maps take it: by time, then source, then view."""
        batch = sorted(self._waiting.values(), key=lambda p: (p.header.stamp_ns, p.key))
        numbers = self._log(batch)
        if numbers is None:
            return
        self._waiting.clear()
        for number, perceived in zip(numbers, batch, strict=True):
            self._take(number, perceived)
        if self._journal is not None:
            self._journal.write_events()

    def _log(self, batch: list[PerceivedView]) -> list[int] | None:
        """Commits views; returns their numbers, or None if that can't be done now."""
        if self._journal is None:
            return [0] * len(batch)
        try:
            return self._journal.append(batch)
        except StoreError as error:
            self._journal.block(error)
            if error.name == "corrupt":
                self._begin_anew(self._journal, error.name, str(error))
            return None

    def _take(self, number: int, perceived: PerceivedView, *, again: bool = False) -> None:
        """Has the maps take a view. ``again``: after a restart, when what is wrong with it was said before."""
        with self._whole:
            self._take_whole(number, perceived, again)

    def _take_whole(self, number: int, perceived: PerceivedView, again: bool) -> None:
        source, view = perceived.key
        refused, floor, taken = perceived.fault, "", False
        changes: tuple[ObjectChange, ...] = ()
        if perceived.view is not None:
            missed = self.joint.validator.missed.get(source, 0)
            try:
                with self.lock:
                    done = self.joint.accept(perceived.view, perceived.perception)
                if done is not None:
                    floor, changes, taken = done.floor, done.changes, True
                if not again and (gap := self.joint.validator.missed.get(source, 0) - missed):
                    self._node.reject("view.missing_seq", f"{source} skipped {gap} before {perceived.header.seq}")
            except ViewError as error:
                refused, floor = str(error), self._floor_of(perceived, error.name)
        if refused and not again:
            self._node.reject(f"view.{refused.partition(':')[0]}", f"{source} view {view}: {refused}")
        self.contents.note(perceived, floor, refused, taken=taken)
        if self._journal is not None:
            self._journal.note(number, perceived, floor, changes, taken=taken)

    def _floor_of(self, perceived: PerceivedView, fault: str) -> str:
        """The floor that a refused view was taken on, "" if unknown."""
        if fault in _PLACE_UNKNOWN or perceived.view is None:
            return ""
        with self.lock:
            return self.joint.floor_at(perceived.view.floor_z_m)

    # --- the file -------------------------------------------------------------------------------------------------

    def _make_ready(self) -> bool:
        """Sees that maps and file hold everything again that they held before the last restart."""
        if self._journal is None:
            return True
        self._restored = self._restored or self._restore(self._journal)
        return self._restored and self._furnish(self._journal)

    def _restore(self, journal: Journal) -> bool:
        """Takes up what the file holds; False: it can't be read now. What can't be used is said and set aside."""
        began_s, name, message = time.monotonic(), "", ""
        try:
            journal.load(self._thaw)
            journal.replay(lambda number, perceived: self._take(number, perceived, again=True))
        except (SnapshotError, StoreError) as error:
            if isinstance(error, StoreError) and error.name == "unwritable":
                journal.block(error)
                return False
            name, message = error.name, str(error)
        if name and not self._begin_anew(journal, name, message):
            return False
        if self.joint.revision:
            seconds = round(time.monotonic() - began_s, 2)
            self._node.log.info("restored", revision=self.joint.revision, seconds=seconds)
        return True

    def _begin_anew(self, journal: Journal, name: str, message: str) -> bool:
        """Sets a file aside that is of no use any more; the maps go into the new one before any view."""
        try:
            aside = journal.begin_anew(name)
        except StoreError as error:
            journal.block(error)
            return False
        self._node.log.warning(f"store_{name}", error=message, moved_to=str(aside), revision=self.joint.revision)
        self._lacks_maps = bool(self.joint.revision or self.contents.robots or self.contents.views)
        return True

    def _furnish(self, journal: Journal) -> bool:
        """Sees that the file holds what the maps held when it was begun anew."""
        if self._lacks_maps:
            try:
                journal.save_first(self._frozen())
            except StoreError as error:
                journal.block(error)
                return False
            self._lacks_maps = False
        return True

    def _frozen(self) -> State:
        """A copy of the maps and of what they have processed."""
        with self.lock:
            maps = freeze(self.joint)
        return {"maps": maps, "held": self.contents.state()}  # the word that files of all versions have

    def _thaw(self, state: State) -> None:
        """Takes up a copy. SnapshotError: these maps can't go on from it."""
        joint = thaw(state["maps"], self.joint.config)
        with self.lock:
            self.joint = joint
        self.contents = MapContents.from_state(state["held"])
