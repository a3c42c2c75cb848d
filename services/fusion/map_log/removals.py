"""Takes the contribution of a source, or of a time span, out of the maps: asked for by any thread, done by the main loop."""

from __future__ import annotations

import queue
import time
from concurrent.futures import Future
from dataclasses import dataclass, replace

from surveilnav.bus import Node, Refused, clock_ns
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core.removal import sources_to_remove
from surveilnav.services.fusion.map_log.rebuild import MapRebuild
from surveilnav.services.fusion.map_log.recovery import has_clean_base
from surveilnav.services.fusion.map_log.removal import Removal, RemovalState, Way
from surveilnav.services.fusion.map_log.store import Store, StoreError

_MAX_KNOWN = 100  # removals that are told of
_ANSWER_S = 4.0
_RETRY_S = 30.0  # after a camera in quarantine couldn't be removed
_REMAINS = (
    "the log doesn't reach back far enough: what {source} alone has seen is gone; where others look too, its points stay in "
    "the mean, and obstacles and explored floor that no voxel tells of stay"
)


@dataclass(frozen=True, slots=True)
class RemovalRequest:
    """What is to be removed, and where its answer goes."""

    source: str
    since_ns: int | None
    until_ns: int | None
    answer: Future[Removal]

    def removal(self) -> Removal:
        """The removal that is asked for, without an id."""
        return replace(_new_removal(self.source), since_ns=self.since_ns, until_ns=self.until_ns)


class Removals:
    """Carries out removals, one at a time.

    Every removal is committed to the file before it begins, and names the newest view at that time. From then on it holds:
    after a restart at any moment the maps become those that they would have become.

    Attributes:
        known: the newest removals, oldest first; of this process, and of the file.
    """

    def __init__(self, node: Node, store: Store | None, maps: BuildingMaps) -> None:
        """``store``: None if the maps end with the process."""
        self._node, self._store, self._maps = node, store, maps
        self._requests: queue.SimpleQueue[RemovalRequest] = queue.SimpleQueue()
        self._rebuild: MapRebuild | None = None
        self._running: Removal | None = None
        self._began_s = self._retry_at_s = 0.0
        self.known: list[Removal] = []
        self._changes: list[Removal] = []

    @property
    def is_running(self) -> bool:
        """Whether maps are being computed again. Meanwhile no snapshot is written, so that the log stays as it is."""
        return self._rebuild is not None

    @property
    def progress(self) -> tuple[int, int]:
        """How many views of how many the maps that are being computed have processed. Safe from any thread."""
        rebuild = self._rebuild
        if rebuild is None or rebuild.begin_number is None:
            return 0, 0
        return rebuild.maps.number - rebuild.begin_number, self._maps.number - rebuild.begin_number

    def load(self) -> list[Removal]:
        """Reads the removals of the file, and returns those that the maps must reflect, oldest first. Raises StoreError."""
        if self._store is None:
            return []
        stored = self._store.removals()
        self.known = stored[-_MAX_KNOWN:]
        return [r for r in stored if r.state != "failed"]

    def finish_after_restart(self) -> None:
        """Marks removals as done that the restored maps reflect. Raises StoreError."""
        for removal in [r for r in self.known if r.state == "running" and r.id <= self._maps.removals]:
            self._end(removal, "done", "completed when fusion was started again")

    def ask(self, source: str, since_ns: int | None, until_ns: int | None) -> Removal:
        """Has the main loop begin a removal, and returns it as it began. Safe from any thread.

        Raises:
            Refused: unknown_source, busy or store_down.
        """
        request = RemovalRequest(source, since_ns, until_ns, Future())
        self._requests.put(request)
        self._node.wake.set()
        try:
            return request.answer.result(_ANSWER_S)
        except TimeoutError:
            request.answer.cancel()
            raise Refused("busy", "fusion is busy: try again", retry_after_ms=1000) from None

    def pop_changes(self) -> list[Removal]:
        """Removals that have begun or ended since the last call, oldest first. For the main loop."""
        changes, self._changes = self._changes, []
        return changes

    def step(self, *, ready: bool) -> Way | None:
        """One turn of the main loop. ``ready``: whether the file holds all that the maps hold.

        Returns:
            The way in which the maps have changed; None if they haven't. ``replay``: others, whose events are in the file, have
            taken their place.
        """
        changed: Way | None = "replay" if self._running is not None and self._finish() else None
        while not self._requests.empty():
            request = self._requests.get()
            if not request.answer.set_running_or_notify_cancel():
                continue
            try:
                removal = self._begin(request.removal(), ready=ready)
                changed = changed or _changed_at_once(removal)
                request.answer.set_result(removal)
            except Refused as refused:
                request.answer.set_exception(refused)
        if ready and self._running is None and time.monotonic() >= self._retry_at_s:
            changed = changed or self._remove_quarantined()
        return changed

    def close(self) -> None:
        """Stops computing; the next start goes on with it."""
        if self._rebuild is not None:
            self._rebuild.close()

    def _remove_quarantined(self) -> Way | None:
        """Removes a camera that isn't believed any more; returns the way in which the maps have changed."""
        sources, quarantine = sources_to_remove(self._maps.joint), self._maps.joint.quarantine
        if not sources:
            return None
        source = sources[0]
        why = f"the camera isn't believed: {quarantine.reasons()[source]}"
        self._retry_at_s = time.monotonic() + _RETRY_S  # should it fail
        try:
            removal = replace(_new_removal(source), message=why, quarantined=quarantine.state_of(source))
            return _changed_at_once(self._begin(removal, ready=True))
        except Refused as refused:
            self._node.warn_seldom("a camera in quarantine can't be removed from the maps", error=str(refused))
            return None

    def _begin(self, removal: Removal, *, ready: bool) -> Removal:
        """Commits a removal, which has no id yet, and begins it. Refused: as ``ask``."""
        spans = self._maps.processed.spans
        if removal.source not in spans:
            known = ", ".join(sorted(spans)) or "none yet"
            raise Refused("unknown_source", f"the maps hold no views of {removal.source}; they hold some of {known}")
        if self._running is not None:
            retry_ms = 5000
            raise Refused("busy", f"{self._running.source} is still being removed: try again", retry_after_ms=retry_ms)
        if not ready:
            raise Refused("store_down", "fusion's store can't be written now, so a removal might not last: try again")
        try:
            removal = self._committed(replace(removal, number=self._maps.number))
        except StoreError as error:
            raise Refused("store_down", f"fusion's store can't be written: {error}") from error
        self._began_s = time.monotonic()
        self._changes.append(removal)
        self._node.log.warning("removal_begins", **_facts(removal))
        if removal.way == "provenance":
            return self._remove_by_provenance(removal)
        assert self._store is not None
        self._running = removal
        self._rebuild = MapRebuild(self._store, self._node, self._maps, self._effective())
        return removal

    def _committed(self, removal: Removal) -> Removal:
        """The removal with its id and the way in which it can be carried out, once it is in the file. Raises StoreError."""
        if self._store is None:
            removal = replace(removal, id=self._maps.removals + 1, way="provenance")
        else:
            candidate = replace(removal, id=self._maps.removals + 1)  # any id after those that the maps reflect
            way: Way = "replay" if has_clean_base(self._store, [*self._effective(), candidate]) else "provenance"
            removal = replace(removal, way=way)
            removal = replace(removal, id=self._store.put_removal(removal))
        self.known = [*self.known, removal][-_MAX_KNOWN:]
        return removal

    def _effective(self) -> list[Removal]:
        """The removals of the file that the maps must reflect. Raises StoreError."""
        assert self._store is not None
        return [r for r in self._store.removals() if r.state != "failed"]

    def _remove_by_provenance(self, removal: Removal) -> Removal:
        try:
            self._maps.remove_by_provenance(removal)
        except Exception as error:  # the maps are as they were, and fusion must go on
            return self._end(removal, "failed", f"it can't be taken out of the maps: {type(error).__name__}: {error}")
        return self._end(removal, "done", _REMAINS.format(source=removal.source))

    def _finish(self) -> bool:
        """Swaps the maps if the new ones are complete; returns whether they were."""
        rebuild, removal = self._rebuild, self._running
        assert rebuild is not None
        assert removal is not None
        assert self._store is not None
        if rebuild.error is not None:
            self._give_up(removal, rebuild.error)
            return False
        if not rebuild.is_complete():
            return False
        assert rebuild.begin_number is not None
        try:
            self._store.replace_events(rebuild.begin_number, rebuild.events)
        except StoreError as error:
            self._node.warn_seldom("events can't be written", error=str(error))
            return False
        rebuild.close()
        self._maps.replace_by(rebuild.maps)
        self._rebuild = self._running = None
        message = f"the maps were computed again from {rebuild.n_views} logged views, without {removal.source}"
        if rebuild.by_provenance:
            removal, message = replace(removal, way="provenance"), _REMAINS.format(source=removal.source)
        self._end(removal, "done", message)
        return True

    def _give_up(self, removal: Removal, error: Exception) -> None:
        assert self._rebuild is not None
        self._rebuild.close()
        self._rebuild = self._running = None
        self._end(removal, "failed", f"the log can't be replayed: {error}")

    def _end(self, removal: Removal, state: RemovalState, message: str) -> Removal:
        message = "; ".join(filter(None, (removal.message, message)))
        ended = replace(removal, state=state, message=message, finished_ns=clock_ns())
        self._retry_at_s = 0.0 if state == "done" else self._retry_at_s
        self.known = [ended if r.id == ended.id else r for r in self.known]
        self._changes.append(ended)
        seconds = round(time.monotonic() - self._began_s, 2) if self._began_s else None
        self._node.log.warning(f"removal_{state}", **_facts(ended), seconds=seconds, message=message)
        try:
            if self._store is not None:
                self._store.put_removal(ended)
        except StoreError as error:  # the next start ends it again
            self._node.warn_seldom("the end of a removal can't be written", error=str(error))
        return ended


def _new_removal(source: str) -> Removal:
    return Removal(0, 0, source, None, None, "replay", clock_ns())


def _changed_at_once(begun: Removal) -> Way | None:
    """The way in which a removal that has just begun has changed the maps already; None if they are computed again first."""
    return "provenance" if begun.way == "provenance" else None


def _facts(removal: Removal) -> dict[str, object]:
    return {
        "removal": removal.id,
        "source": removal.source,
        "since_ns": removal.since_ns,
        "until_ns": removal.until_ns,
        "way": removal.way,
    }
