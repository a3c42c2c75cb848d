"""Which changes of the building's state are events: rules that compare two states of one thing, and the events they make.

A rule gets the state before (None: not known) and the state now (None: the thing is gone), and yields a word for each change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from surveilnav.messages import MapRemoval, MissionStatus, ObjectRecord, ServiceState
from surveilnav.rest import Event
from surveilnav.services.gateway.core.resources import utc

S = TypeVar("S")
#: Remote text is cut to this length, so that the log of events has a bounded size.
_MAX_TEXT = 500


@dataclass(frozen=True, slots=True)
class CameraState:
    """Whether a camera is there and invoked, whether a person paused it, and what its stream is doing.

    It is invoked while the maps of its floor subscribe to it.
    """

    floor: str
    online: bool
    invoked: bool
    paused: bool = False
    stream: str = "live"
    quarantined: bool = False


@dataclass(frozen=True, slots=True)
class RobotSituation:
    """Whether a robot was heard of lately, what it does, on which floor, and why it can't be where it says."""

    online: bool
    state: str
    floor: str
    message: str = ""
    frame_problem: str = ""


@dataclass(frozen=True, slots=True)
class Change(Generic[S]):
    """Thing ``id`` has changed in the way that ``what`` names. ``now`` is its state; of a thing that is gone, its last one."""

    id: str
    what: str
    now: S


class Tracked(Generic[S]):
    """The states of all things of a kind. The first ``update`` is the baseline: what is there then is no change."""

    def __init__(self, rule: Callable[[S | None, S | None], Iterable[str]]) -> None:
        self._rule = rule
        self._known: dict[str, S] | None = None

    def update(self, now: Mapping[str, S]) -> list[Change[S]]:
        """Replaces all states, and returns the changes since the last update."""
        before, self._known = self._known, dict(now)
        if before is None:
            return []
        return [c for id in sorted(before | self._known) for c in self._changes(id, before.get(id), now.get(id))]

    def update_one(self, id: str, state: S) -> list[Change[S]]:
        """Replaces the state of one thing, and returns its changes."""
        if self._known is None:
            return []
        before = self._known.get(id)
        self._known[id] = state
        return self._changes(id, before, state)

    def get(self, id: str) -> S | None:
        return (self._known or {}).get(id)

    def _changes(self, id: str, before: S | None, now: S | None) -> list[Change[S]]:
        state = now if now is not None else before
        assert state is not None
        return [Change(id, what, state) for what in self._rule(before, now)]


# --- rules --------------------------------------------------------------------------------------------------------


def mission_changes(before: MissionStatus | None, now: MissionStatus | None) -> Iterable[str]:
    """The state that a mission came to; ``phase`` where only its phase, robot or floor changed."""
    if now is None:
        return
    if before is None or now.state != before.state:
        yield now.state
    elif (now.phase, now.robot, now.floor) != (before.phase, before.robot, before.floor):
        yield "phase"


def object_changes(before: ObjectRecord | None, now: ObjectRecord | None) -> Iterable[str]:
    """``confirmed``, ``rejected``, ``candidate`` (again), ``gone``. A new candidate is no change: there are too many."""
    if now is None:
        if before is not None and before.status == "confirmed":
            yield "gone"
    elif now.status != (before.status if before else "candidate"):
        yield now.status


def camera_changes(before: CameraState | None, now: CameraState | None) -> Iterable[str]:
    """``new``, ``offline``, ``back``; ``invoked``, ``released``; ``paused``, ``resumed``; ``quarantined``, ``believed``;
    ``stream_<state>``."""
    if now is None:
        return
    if before is None:
        yield "new"
    elif now.online != before.online:
        yield "back" if now.online else "offline"
    if now.invoked != (before is not None and before.invoked):
        yield "invoked" if now.invoked else "released"
    if now.paused != (before is not None and before.paused):
        yield "paused" if now.paused else "resumed"
    if now.quarantined != (before is not None and before.quarantined):
        yield "quarantined" if now.quarantined else "believed"
    if now.stream != (before.stream if before is not None else "live"):
        yield f"stream_{now.stream}"


def robot_changes(before: RobotSituation | None, now: RobotSituation | None) -> Iterable[str]:
    """``new``, ``silent``, ``back``; the state that the robot came to; ``floor`` where it changed floors; ``frame_disagrees``
    where it isn't where it says, ``frame_agrees`` where it is again."""
    if now is None:
        return
    if before is None:
        yield "new"
        return
    if now.online != before.online:
        yield "back" if now.online else "silent"
    if now.state != before.state and now.online:
        yield now.state
    if now.floor != before.floor:
        yield "floor"
    if bool(now.frame_problem) != bool(before.frame_problem):
        yield "frame_disagrees" if now.frame_problem else "frame_agrees"


def process_changes(before: ServiceState | None, now: ServiceState | None) -> Iterable[str]:
    """``ended``, ``running``, ``restarted``, ``given_up``, of a process that a supervisor keeps running."""
    if now is None:
        return
    if now.given_up:
        if before is None or not before.given_up:
            yield "given_up"
    elif before is not None and now.restarts > before.restarts:
        yield "restarted"
    elif now.running != (before.running if before else True):
        yield "running" if now.running else "ended"


def removal_changes(before: MapRemoval | None, now: MapRemoval | None) -> Iterable[str]:
    """The state that a removal from the maps came to: ``running``, ``done`` or ``failed``."""
    if now is not None and (before is None or now.state != before.state):
        yield now.state


def presence_changes(before: bool | None, now: bool | None) -> Iterable[str]:
    """``online``, ``offline``, of a node of a service."""
    if bool(before) != bool(now):
        yield "online" if now else "offline"


# --- events -------------------------------------------------------------------------------------------------------


def mission_event(change: Change[MissionStatus], now_ns: int) -> Event:
    """A mission came to another state or phase."""
    s = change.now
    return Event(
        id=s.mission,
        what=change.what,
        time=utc(now_ns),
        floor=s.floor,
        target=_cut(s.target),
        robot=s.robot,
        state=s.state,
        phase=_cut(s.phase),
        step=s.step,
        found=s.found,
        error=_cut(s.error),
        message=_cut(s.message),
    )


def object_event(change: Change[ObjectRecord], now_ns: int) -> Event:
    """An object was confirmed, rejected, or is open again."""
    o = change.now
    return Event(
        id=str(o.id),
        what=change.what,
        time=utc(now_ns),
        floor=o.floor,
        label=_cut(o.label),
        confidence=o.confidence,
        center_m=o.center_m,
        message=_cut(o.reason),
    )


def camera_event(change: Change[CameraState], now_ns: int) -> Event:
    """A camera came or went, or its invocation or pause changed."""
    return Event(id=change.id, what=change.what, time=utc(now_ns), floor=change.now.floor)


def robot_event(change: Change[RobotSituation], now_ns: int) -> Event:
    """A robot came or fell silent, its state or floor changed, or it isn't where it says."""
    r = change.now
    message = r.frame_problem if change.what == "frame_disagrees" else r.message
    return Event(id=change.id, what=change.what, time=utc(now_ns), floor=r.floor, state=r.state, message=_cut(message))


def process_event(change: Change[ServiceState], now_ns: int) -> Event:
    """A process that is kept running ended or was started again."""
    s = change.now
    return Event(id=_cut(change.id), what=change.what, time=utc(now_ns), restarts=s.restarts, message=_cut(s.why))


def removal_event(change: Change[MapRemoval], now_ns: int) -> Event:
    """What a camera or a robot has contributed is being taken out of the maps, or was, or couldn't be."""
    r = change.now
    return Event(id=change.id, what=change.what, time=utc(now_ns), source=_cut(r.source), message=_cut(r.message))


def presence_event(change: Change[bool], now_ns: int) -> Event:
    """A node of a service announced itself or left."""
    return Event(id=change.id, what=change.what, time=utc(now_ns))


def _cut(text: str) -> str:
    return text[:_MAX_TEXT]
