"""The joint maps of the building and what they have processed, shared by all threads of the service."""

from __future__ import annotations

import secrets
import threading
from dataclasses import dataclass
from typing import Any

from surveilnav.messages import FrameHeader
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.objects.map_object import ObjectChange
from surveilnav.services.fusion.core.removal import without
from surveilnav.services.fusion.core.snapshot import freeze, thaw
from surveilnav.services.fusion.core.views.validation import ViewError
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.perceived import PerceivedView, ViewKey

#: A copy of the maps and of what they have processed, as plain values (``BuildingMaps.freeze``).
State = dict[str, Any]

_ANY_TIME = -(2**62), 2**62
#: Names of faults after which it isn't known on which floor a view was taken.
_PLACE_UNKNOWN = {"bad_pose", "pose_jump", "time_backwards", "out_of_map"}


@dataclass(frozen=True, slots=True)
class LastObservation:
    """The newest observation of a robot that was processed (integrated or refused), and on which floor it was made."""

    floor: str
    seq: int
    stamp_ns: int


@dataclass(frozen=True, slots=True)
class Outcome:
    """What integrating a view has led to.

    Attributes:
        floor: the floor that it was integrated into, or refused on; "" if unknown.
        integrated: whether the view entered the maps.
        fault: why it was refused; "" if it wasn't.
        changes: what happened to objects because of this view.
        n_missed: number of observations of the same robot that are missing before this one.
    """

    floor: str = ""
    integrated: bool = False
    fault: str = ""
    changes: tuple[ObjectChange, ...] = ()
    n_missed: int = 0


class ProcessedViews:
    """Which observations and views were processed, that is, integrated or refused for good.

    Attributes:
        robots: the newest processed observation of each robot.
        views: indices of each camera's views of which at least one picture was processed, so that nobody waits for them.
        digests: hash of the picture that was last integrated, for each view of a camera.
        faults: for views whose newest picture was refused, why it was.
        spans: of each source, the stamps [ns] of the first and the last view that the maps processed.
    """

    def __init__(self) -> None:
        self.robots: dict[str, LastObservation] = {}
        self.views: dict[str, set[int]] = {}
        self.digests: dict[ViewKey, bytes] = {}
        self.faults: dict[ViewKey, str] = {}
        self.spans: dict[str, tuple[int, int]] = {}

    def contains(self, key: ViewKey, digest: bytes) -> bool:
        """Whether the maps hold exactly this picture of a camera. Safe from any thread."""
        return bool(digest) and key[0].startswith("camera/") and self.digests.get(key) == digest

    def views_of(self, camera: str) -> set[int]:
        return self.views.get(camera, set())

    def repeats_fault(self, perceived: PerceivedView) -> bool:
        """Whether a picture of a camera has a fault, and the view's previous picture had the same."""
        key, fault = perceived.key, perceived.fault
        return bool(fault) and key[0].startswith("camera/") and self.faults.get(key) == _fault_message(perceived, fault)

    def record(self, perceived: PerceivedView, outcome: Outcome) -> None:
        kind, _, name = perceived.key[0].partition("/")
        header = perceived.header
        first_ns, last_ns = self.spans.get(perceived.key[0], (header.stamp_ns, header.stamp_ns))
        self.spans[perceived.key[0]] = min(first_ns, header.stamp_ns), max(last_ns, header.stamp_ns)
        if kind == "robot":
            self.acknowledge(header, outcome.floor)
        else:
            self.views.setdefault(name, set()).add(perceived.key[1])
            if outcome.integrated and perceived.digest:
                self.digests[perceived.key] = perceived.digest
        self.faults.pop(perceived.key, None)
        if outcome.fault:
            self.faults[perceived.key] = _fault_message(perceived, outcome.fault)

    def acknowledge(self, header: FrameHeader, floor: str = "") -> None:
        """Records a robot's observation as processed, so that nobody waits for it. ``floor``: where it was made; "": unknown."""
        name = header.source.partition("/")[2]
        last = self.robots.get(name)
        self.robots[name] = LastObservation(
            floor or (last.floor if last else header.floor), header.seq, header.stamp_ns
        )

    def drop(self, source: str) -> None:
        """Forgets a camera's views, so that it is looked through anew, and a source's faults. Spans stay."""
        kind, _, name = source.partition("/")
        if kind == "camera":
            self.views.pop(name, None)
        self.digests = {key: digest for key, digest in self.digests.items() if key[0] != source}
        self.faults = {key: why for key, why in self.faults.items() if key[0] != source}

    def state(self) -> State:
        """Everything as plain values, for ``from_state``."""
        return {
            "robots": {name: [r.floor, r.seq, r.stamp_ns] for name, r in self.robots.items()},
            "views": {name: sorted(views) for name, views in self.views.items()},
            "digests": [[*key, digest] for key, digest in self.digests.items()],
            "faults": [[*key, why] for key, why in self.faults.items()],
            "spans": {source: list(span) for source, span in self.spans.items()},
        }

    @classmethod
    def from_state(cls, state: State) -> ProcessedViews:
        processed = cls()
        processed.robots = {name: LastObservation(*fields) for name, fields in state["robots"].items()}
        processed.views = {name: set(views) for name, views in state["views"].items()}
        processed.digests = {(source, view): digest for source, view, digest in state["digests"]}
        processed.faults = {(source, view): why for source, view, why in state["faults"]}
        if "spans" in state:
            processed.spans = {source: (first_ns, last_ns) for source, (first_ns, last_ns) in state["spans"].items()}
        else:  # an earlier program's snapshot says whose views it has, but not when they were taken
            sources = [*(f"robot/{name}" for name in processed.robots), *(f"camera/{name}" for name in processed.views)]
            processed.spans = dict.fromkeys(sources, _ANY_TIME)
        return processed


class BuildingMaps:
    """The joint maps and what they have processed. One thread writes (``integrate``, ``restore``); all may read.

    Attributes:
        joint: the joint maps. Whoever reads or changes them holds ``lock``.
        processed: which views they have processed.
        number: the log number of the view that was processed last; 0 without a log.
        epoch: changes when revisions start anew, as after a restart. Revisions of different epochs can't be compared.
        removals: id of the newest removal (``map_log.removal``) that the maps reflect, as they do all before; 0: none.
    """

    def __init__(self, config: FusionConfig) -> None:
        self.joint = JointMap(config)
        self.processed = ProcessedViews()
        self.number = self.removals = 0
        self.epoch = _new_epoch()
        self.lock = threading.Lock()

    def integrate(self, perceived: PerceivedView, number: int = 0) -> Outcome:
        """Integrates a view or refuses it, and records it as processed. ``number``: the view's number in the log."""
        with self.lock:
            self.number = number
            outcome = self._integrate(perceived)
            self.processed.record(perceived, outcome)
        return outcome

    def _integrate(self, perceived: PerceivedView) -> Outcome:
        if perceived.view is None:
            return Outcome(fault=perceived.fault)
        source, missed = perceived.key[0], self.joint.validator.missed
        missed_before = missed.get(source, 0)
        try:
            result = self.joint.accept(perceived.view, perceived.perception)
        except ViewError as error:
            unknown = error.name in _PLACE_UNKNOWN
            floor = "" if unknown else self.joint.floor_at(perceived.view.floor_z_m)
            return Outcome(floor, fault=str(error))
        n_missed = missed.get(source, 0) - missed_before
        if result is None:
            return Outcome(n_missed=n_missed)
        return Outcome(result.floor, True, "", result.changes, n_missed)

    def skip(self, header: FrameHeader, number: int) -> None:
        """Passes over a view that was removed. That a robot's observation was processed is still true."""
        with self.lock:
            self.number = number
            if header.source.startswith("robot/"):
                self.processed.acknowledge(header)

    def remove_by_provenance(self, removal: Removal) -> None:
        """Takes what a source alone has contributed out of the maps, as far as they know whose it is."""
        with self.lock:
            self.joint = without(self.joint, removal.contribution)
            self.processed.drop(removal.source)
            self.removals, self.epoch = removal.id, _new_epoch()
        self.update_quarantine(removal)

    def update_quarantine(self, removal: Removal) -> None:
        """A camera that somebody had removed begins anew; one that was removed because it isn't believed stays so."""
        with self.lock:
            if removal.quarantined is not None:
                self.joint.quarantine.adopt(removal.source, removal.quarantined)
            elif removal.contribution.is_whole:
                self.joint.quarantine.forget(removal.source)

    def replace_by(self, other: BuildingMaps) -> None:
        """Takes over the maps of another instance, which nobody uses any more, under a new epoch."""
        with self.lock:
            self.joint, self.processed = other.joint, other.processed
            self.number, self.removals, self.epoch = other.number, other.removals, _new_epoch()

    def freeze(self) -> State:
        """A copy of everything, which stays as it is when the maps change. Safe from any thread."""
        with self.lock:
            return {
                "number": self.number,
                "removals": self.removals,
                "maps": freeze(self.joint),
                "processed": self.processed.state(),
            }

    def restore(self, state: State) -> None:
        """Replaces everything by a copy that ``freeze`` made. SnapshotError: it can't be restored."""
        joint = thaw(state["maps"], self.joint.config)
        processed = ProcessedViews.from_state(state["processed"])
        with self.lock:
            self.joint, self.processed, self.number = joint, processed, state["number"]
            self.removals, self.epoch = state.get("removals", 0), _new_epoch()


def _new_epoch() -> str:
    return secrets.token_hex(6)


def _fault_message(perceived: PerceivedView, fault: str) -> str:
    source, view = perceived.key
    which = perceived.header.seq if source.startswith("robot/") else view
    return f"view {which} of {source} was refused: {fault}"
