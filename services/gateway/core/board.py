"""The newest state of each thing, numbered in the order of its changes: who was away gets what changed, not what happened.

A reader keeps one number. It asks for what changed after that, however much happened meanwhile: of each thing only the
newest state is kept. A thing that is gone leaves a row that says so.
"""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Collection
from itertools import takewhile

from surveilnav.services.gateway.core.event_log import Event, Position, number_in

#: Rows of things that are gone, kept for readers that still show them.
_MOST_GONE = 1000


class Board:
    """Rows by kind and id. Not safe for several threads: its owner locks it."""

    advice = "forget all that you were told before: the state of everything follows"

    def __init__(self, epoch: str) -> None:
        self._epoch = epoch
        self._rows: OrderedDict[tuple[str, str], Event] = OrderedDict()  # the last changed at the end
        self._gone: OrderedDict[tuple[str, str], None] = OrderedDict()
        self.newest = 0

    def show(self, kind: str, id: str, state: str | None) -> bool:
        """Whether the ``state`` (JSON on one line; None: it is gone) of a thing is another than what was shown."""
        data = f'{{"id":{json.dumps(id)},"state":{"null" if state is None else state}}}'
        key, known = (kind, id), self._rows.get((kind, id))
        if (known is not None and known.data == data) or (known is None and state is None):
            return False
        self.newest += 1
        self._rows[key] = Event(self.newest, kind, data)
        self._rows.move_to_end(key)
        self._gone.pop(key, None)
        if state is None:
            self._gone[key] = None
            if len(self._gone) > _MOST_GONE:
                del self._rows[self._gone.popitem(last=False)[0]]
        return True

    def id_of(self, number: int) -> str:
        """The id that a reader comes back with."""
        return f"{self._epoch}-{number}"

    def position(self, last_id: str | None) -> Position:
        """Where a reader goes on; from the beginning, with a reason, if its id is none of this run's."""
        number = number_in(last_id or "", self._epoch)
        if number is None or number > self.newest:
            return Position(0, "the state of everything follows")
        return Position(number)

    def checked(self, number: int) -> Position:
        """There: no state is ever missing."""
        return Position(number)

    def after(self, number: int, ids: Collection[str] | None = None, limit: int = 100) -> list[Event]:
        """At most ``limit`` rows that changed after ``number``, the first changed first; those of ``ids`` alone, or all."""
        newer = list(takewhile(lambda row: row[1].number > number, reversed(self._rows.items())))
        return [row for (_, id), row in reversed(newer) if ids is None or id in ids][:limit]
