"""What happened, in order and numbered, so that who was cut off can go on where it was.

Ids are ``{epoch}-{number}``: the epoch names one run of the gateway, the number counts its events from 1. Both together
tell an id of an earlier run, and one that is older than what is kept, from one that can be gone on from.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Collection
from dataclasses import dataclass
from itertools import islice

_ID = re.compile(r"([0-9a-z]{1,32})-(\d{1,18})")


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened: its number, what kind of thing, and what is told of it (JSON on one line)."""

    number: int
    kind: str
    data: str


@dataclass(frozen=True, slots=True)
class Position:
    """How far a reader has come: it has events up to ``number``. ``gap`` says why earlier ones can't be had; empty: none
    are missing."""

    number: int
    gap: str = ""


def number_in(id: str, epoch: str) -> int | None:
    """The number in an id of that run; None if it is of another, or no id at all."""
    match = _ID.fullmatch(id)
    return int(match[2]) if match and match[1] == epoch else None


class EventLog:
    """The newest ``capacity`` events of this run. Not safe for several threads: its owner locks it."""

    advice = "read the state anew (missions, cameras, robots, objects), then go on from this id"

    def __init__(self, epoch: str, capacity: int = 10_000) -> None:
        self._epoch = epoch
        self._events: deque[Event] = deque(maxlen=capacity)
        self.newest = 0

    def append(self, kind: str, data: str) -> Event:
        """Keeps an event; the oldest goes where there is no room."""
        self.newest += 1
        event = Event(self.newest, kind, data)
        self._events.append(event)
        return event

    def id_of(self, number: int) -> str:
        """The id of the event with that number."""
        return f"{self._epoch}-{number}"

    def position(self, last_id: str | None) -> Position:
        """Where a reader goes on whose last event had that id; None or "": it comes for the first time."""
        if not last_id:
            return Position(self.newest, "you come for the first time")
        match = _ID.fullmatch(last_id)
        if match is None:
            return Position(self.newest, "your Last-Event-ID is none of this gateway's")
        if match[1] != self._epoch:
            return Position(self.newest, "the gateway was started anew since your last event")
        number = int(match[2])
        if number > self.newest:
            return Position(self.newest, "your Last-Event-ID is of an event that never was")
        return self.checked(number)

    def checked(self, number: int) -> Position:
        """Where a reader goes on that has events up to ``number``: there, or now if the next ones aren't kept any more."""
        if self._events and number < self._events[0].number - 1:
            return Position(self.newest, f"only the newest {len(self._events)} events are kept")
        return Position(number)

    def after(self, number: int, ids: Collection[str] | None = None, limit: int = 100) -> list[Event]:
        """At most ``limit`` events after ``number``, the oldest first. Who listens hears of all: ``ids`` choose nothing."""
        if not self._events or number >= self.newest:
            return []
        begin = max(0, number + 1 - self._events[0].number)
        return list(islice(self._events, begin, begin + limit))
