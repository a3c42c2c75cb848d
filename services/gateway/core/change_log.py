"""Numbered changes that a reader can resume from: ``EventLog`` keeps every event, ``StateLog`` the newest state of each thing.

The id of an entry is ``{epoch}-{number}``. The epoch names one run of the gateway, and the number counts its entries from 1.
So an id tells whether it is of an earlier run, older than what is kept, or one that the reader can go on from.
Neither class is thread-safe: their owner locks them.
"""

from __future__ import annotations

import json
import re
from collections import OrderedDict, deque
from collections.abc import Collection
from dataclasses import dataclass
from itertools import islice, takewhile

_ID = re.compile(r"([0-9a-z]{1,32})-(\d{1,18})")
#: How many rows of things that are gone are kept, for readers that still show them.
_MAX_GONE = 1000


@dataclass(frozen=True, slots=True)
class LogEntry:
    """One change: its number, the kind of thing that changed, and what readers are sent (JSON on one line)."""

    number: int
    kind: str
    data: str


@dataclass(frozen=True, slots=True)
class ReadPosition:
    """How far a reader is: it has the entries up to ``number``. ``gap`` says why earlier ones can't be had; empty if none
    are missing."""

    number: int
    gap: str = ""


def number_in(id: str, epoch: str) -> int | None:
    """The number in an id of that run; None if it is of another run, or no id at all."""
    match = _ID.fullmatch(id)
    return int(match[2]) if match and match[1] == epoch else None


class EventLog:
    """The newest ``capacity`` events of this run: what happened, in order."""

    advice = "read the state anew (missions, cameras, robots, objects), then go on from this id"

    def __init__(self, epoch: str, capacity: int = 10_000) -> None:
        self._epoch = epoch
        self._entries: deque[LogEntry] = deque(maxlen=capacity)
        self.newest = 0

    def append(self, kind: str, data: str) -> LogEntry:
        """Adds an event; when the log is full, the oldest is dropped."""
        self.newest += 1
        entry = LogEntry(self.newest, kind, data)
        self._entries.append(entry)
        return entry

    def id_of(self, number: int) -> str:
        return f"{self._epoch}-{number}"

    def position(self, last_id: str | None) -> ReadPosition:
        """Where a reader goes on whose last event had that id. None or "" means that it comes for the first time."""
        if not last_id:
            return ReadPosition(self.newest, "you come for the first time")
        match = _ID.fullmatch(last_id)
        if match is None:
            return ReadPosition(self.newest, "your Last-Event-ID is none of this gateway's")
        if match[1] != self._epoch:
            return ReadPosition(self.newest, "the gateway was started anew since your last event")
        number = int(match[2])
        if number > self.newest:
            return ReadPosition(self.newest, "your Last-Event-ID is of an event that never was")
        return self.checked(number)

    def checked(self, number: int) -> ReadPosition:
        """Where a reader goes on that has the events up to ``number``: there, or at the end if the next ones were dropped."""
        if self._entries and number < self._entries[0].number - 1:
            return ReadPosition(self.newest, f"only the newest {len(self._entries)} events are kept")
        return ReadPosition(number)

    def after(self, number: int, ids: Collection[str] | None = None, limit: int = 100) -> list[LogEntry]:
        """At most ``limit`` events after ``number``, the oldest first. ``ids`` is ignored: events are for all readers."""
        if not self._entries or number >= self.newest:
            return []
        begin = max(0, number + 1 - self._entries[0].number)
        return list(islice(self._entries, begin, begin + limit))


class StateLog:
    """The newest state of each thing, by kind and id, numbered in the order of changes.

    A reader keeps one number and asks for what changed after it. However much happened meanwhile, it gets each thing once,
    with its newest state. A thing that is gone leaves a row that says so.
    """

    advice = "forget all that you were told before: the state of everything follows"

    def __init__(self, epoch: str) -> None:
        self._epoch = epoch
        self._rows: OrderedDict[tuple[str, str], LogEntry] = OrderedDict()  # the last changed at the end
        self._gone: OrderedDict[tuple[str, str], None] = OrderedDict()
        self.newest = 0

    def update(self, kind: str, id: str, state: str | None) -> bool:
        """Sets the state of a thing (JSON on one line; None: it is gone), and returns whether that is a change."""
        data = f'{{"id":{json.dumps(id)},"state":{"null" if state is None else state}}}'
        key, known = (kind, id), self._rows.get((kind, id))
        if (known is not None and known.data == data) or (known is None and state is None):
            return False
        self.newest += 1
        self._rows[key] = LogEntry(self.newest, kind, data)
        self._rows.move_to_end(key)
        self._gone.pop(key, None)
        if state is None:
            self._gone[key] = None
            if len(self._gone) > _MAX_GONE:
                del self._rows[self._gone.popitem(last=False)[0]]
        return True

    def id_of(self, number: int) -> str:
        """The id that a reader comes back with."""
        return f"{self._epoch}-{number}"

    def position(self, last_id: str | None) -> ReadPosition:
        """Where a reader goes on; from the beginning, with a reason, if its id isn't of this run."""
        number = number_in(last_id or "", self._epoch)
        if number is None or number > self.newest:
            return ReadPosition(0, "the state of everything follows")
        return ReadPosition(number)

    def checked(self, number: int) -> ReadPosition:
        """The same position: no state is ever missing."""
        return ReadPosition(number)

    def after(self, number: int, ids: Collection[str] | None = None, limit: int = 100) -> list[LogEntry]:
        """At most ``limit`` rows that changed after ``number``, the first changed first. ``ids``: of these things only."""
        newer = list(takewhile(lambda row: row[1].number > number, reversed(self._rows.items())))
        return [row for (_, id), row in reversed(newer) if ids is None or id in ids][:limit]
