"""What the network can name: its classes and kinds of rooms, from ``data/classes.json``.

A piece of furniture belongs to the class that lists what ``surveilnav.simulator.world.labels.word_for`` calls it. A room is
of the
first kind one of whose words its name holds ("Flat 0.1 bath" -> "bathroom").
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import msgspec

from surveilnav.words import canonical

_FILE = Path(__file__).parent / "data" / "classes.json"


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The file: by class and by kind of room, the words that mean it."""

    classes: dict[str, list[str]]
    rooms: dict[str, list[str]]


@dataclass(frozen=True, slots=True)
class Classes:
    """Names by number. ``names``: C classes; ``rooms``: R kinds of rooms."""

    names: tuple[str, ...]
    rooms: tuple[str, ...]
    _number_of: dict[str, int]
    _kinds: dict[str, int]

    def number_of(self, word: str) -> int:
        """The class that a word means, or -1."""
        return self._number_of.get(canonical(word), -1)

    @property
    def meanings(self) -> dict[str, str]:
        """By a word that is no class's name, the class that it means ("chest": "chest of drawers")."""
        return {word: self.names[i] for word, i in self._number_of.items() if word != self.names[i]}

    def room_of(self, name: str) -> int:
        """The kind of a room of that name, or -1."""
        return next((self._kinds[w] for w in re.findall(r"[a-z]+", name.lower()) if w in self._kinds), -1)


@cache
def load() -> Classes:
    table = msgspec.json.decode(_FILE.read_bytes(), type=_Table)
    number_of = {canonical(word): i for i, words in enumerate(table.classes.values()) for word in words}
    kinds = {word: i for i, words in enumerate(table.rooms.values()) for word in words}
    return Classes(tuple(table.classes), tuple(table.rooms), number_of, kinds)
