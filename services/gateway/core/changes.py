"""What of the building's state is worth an event: rules that compare two states of one thing, and name what changed.

A rule gets the state before (None: it wasn't known) and now (None: it is gone), and gives a word for each change.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

from surveilnav.messages import MissionStatus, ObjectRecord, ServiceState

S = TypeVar("S")


@dataclass(frozen=True, slots=True)
class CameraState:
    """Whether a camera is there, whether the maps of its floor ask it for views, and whether a person paused it."""

    floor: str
    online: bool
    invoked: bool
    paused: bool = False


@dataclass(frozen=True, slots=True)
class RobotSituation:
    """A robot: whether it was heard of lately, what it does, and where."""

    online: bool
    state: str
    floor: str
    message: str = ""


@dataclass(frozen=True, slots=True)
class Change(Generic[S]):
    """Thing ``id`` has changed in the way that ``what`` names; ``now``: its state, or its last one if it is gone."""

    id: str
    what: str
    now: S


class Tracked(Generic[S]):
    """The states of all things of a kind. What is there at the first ``update`` is no news, nor anything before it."""

    def __init__(self, rule: Callable[[S | None, S | None], Iterable[str]]) -> None:
        self._rule = rule
        self._known: dict[str, S] | None = None

    def update(self, now: Mapping[str, S]) -> list[Change[S]]:
        """The changes since the last update, of things that are there or went."""
        before, self._known = self._known, dict(now)
        if before is None:
            return []
        return [c for id in sorted(before | self._known) for c in self._changes(id, before.get(id), now.get(id))]

    def update_one(self, id: str, state: S) -> list[Change[S]]:
        """The changes of one thing."""
        if self._known is None:
            return []
        before = self._known.get(id)
        self._known[id] = state
        return self._changes(id, before, state)

    def get(self, id: str) -> S | None:
        """The state last told of a thing."""
        return (self._known or {}).get(id)

    def _changes(self, id: str, before: S | None, now: S | None) -> list[Change[S]]:
        state = now if now is not None else before
        assert state is not None
        return [Change(id, what, state) for what in self._rule(before, now)]


def of_mission(before: MissionStatus | None, now: MissionStatus | None) -> Iterable[str]:
    """The state that a mission came to; ``phase`` where only what it is busy with changed."""
    if now is None:
        return
    if before is None or now.state != before.state:
        yield now.state
    elif (now.phase, now.robot, now.floor) != (before.phase, before.robot, before.floor):
        yield "phase"


def of_object(before: ObjectRecord | None, now: ObjectRecord | None) -> Iterable[str]:
    """``confirmed``, ``rejected``, ``candidate`` (again), ``gone``. A new candidate is none: there are too many."""
    if now is None:
        if before is not None and before.status == "confirmed":
            yield "gone"
    elif now.status != (before.status if before else "candidate"):
        yield now.status


def of_camera(before: CameraState | None, now: CameraState | None) -> Iterable[str]:
    """``new``, ``offline``, ``back``; ``invoked``, ``released``; ``paused``, ``resumed``."""
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


def of_robot(before: RobotSituation | None, now: RobotSituation | None) -> Iterable[str]:
    """``new``, ``silent``, ``back``; the state that it came to; ``floor``."""
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


def of_process(before: ServiceState | None, now: ServiceState | None) -> Iterable[str]:
    """``ended``, ``running``, ``restarted``, ``given_up``, of a process that somebody keeps running."""
    if now is None:
        return
    if now.given_up:
        if before is None or not before.given_up:
            yield "given_up"
    elif before is not None and now.restarts > before.restarts:
        yield "restarted"
    elif now.running != (before.running if before else True):
        yield "running" if now.running else "ended"


def of_presence(before: bool | None, now: bool | None) -> Iterable[str]:
    """``online``, ``offline``, of a node of a service."""
    if bool(before) != bool(now):
        yield "online" if now else "offline"
