"""How often classes of objects share a room: what stands in for the language models of L3MVN, ESC and VoroNav.

    python -m surveilnav.benchmark.policies.cooccurrence

counts anew over the six example homes that ``train`` is made of (never those of ``val``) and writes
``cooccurrence.json`` beside this file.
"""

from __future__ import annotations

import itertools
import json
import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from surveilnav.simulator.sources import TRAIN_HOMES
from surveilnav.simulator.world.labels import TARGETS

_PATH = Path(__file__).with_name("cooccurrence.json")


@dataclass(frozen=True, slots=True)
class Cooccurrence:
    """Counts over ``n_rooms`` rooms: rooms that hold a class, rooms that hold both of two."""

    n_rooms: int
    rooms: Mapping[str, int]
    both: Mapping[tuple[str, str], int]

    @classmethod
    def of_rooms(cls, rooms: Iterable[Iterable[str]]) -> Cooccurrence:
        """Counts over rooms, each given by the classes in it."""
        sets = [sorted(set(room)) for room in rooms]
        return cls(
            len(sets),
            Counter(label for room in sets for label in room),
            Counter(pair for room in sets for pair in itertools.permutations(room, 2)),
        )

    def likelihood(self, target: str, near: Iterable[str]) -> float:
        """How likely "a room containing ``near``" goes on with ``target`` and not with another of ``TARGETS``, 0-1.

        Naive Bayes with one imagined room more on either side; classes never counted say nothing. 0 for a target
        that isn't one of ``TARGETS``.
        """
        known = sorted(set(near) & set(self.rooms))

        def log_joint(label: str) -> float:
            n = self.rooms.get(label, 0)
            each = ((self.both.get((label, o), 0) + (o == label) * n + 1) / (n + 2) for o in known)
            return math.log((n + 1) / (self.n_rooms + 2)) + sum(math.log(p) for p in each)

        weights = {label: math.exp(log_joint(label)) for label in TARGETS}
        return weights.get(target, 0.0) / sum(weights.values())

    def chance(self, target: str, near: Iterable[str]) -> float:
        """The chance that a room with ``near`` in it has the target, too, 0-1.

        Naive Bayes over rooms with and without the target, with one imagined room more on either side; classes never counted say
        nothing. 0 for a target that was never counted.
        """
        n = self.rooms.get(target, 0)
        if n == 0:
            return 0.0
        log_odds = math.log((n + 1) / (self.n_rooms - n + 1))
        for label in sorted(set(near) & set(self.rooms)):
            both = n if label == target else self.both.get((target, label), 0)
            log_odds += math.log((both + 1) / (n + 2))
            log_odds -= math.log((self.rooms[label] - both + 1) / (self.n_rooms - n + 2))
        return 1.0 / (1.0 + math.exp(-log_odds))

    def to_json(self) -> str:
        """As committed: readable, always the same."""
        pairs = {f"{a} + {b}": n for (a, b), n in sorted(self.both.items()) if a < b}
        content = {
            "what": f"rooms of {', '.join(TRAIN_HOMES)} by classes in them",
            "command": "python -m surveilnav.benchmark.policies.cooccurrence",
            "n_rooms": self.n_rooms,
            "rooms": dict(sorted(self.rooms.items())),
            "both": pairs,
        }
        return json.dumps(content, indent=1) + "\n"


@lru_cache(maxsize=1)
def of_train() -> Cooccurrence:
    """The committed counts."""
    content = json.loads(_PATH.read_text())
    both = {}
    for pair, n in content["both"].items():
        a, b = pair.split(" + ")
        both[a, b] = both[b, a] = n
    return Cooccurrence(content["n_rooms"], content["rooms"], both)


def count_train() -> Cooccurrence:
    """Counted anew. AssetError: the example homes can't be had."""
    from surveilnav.simulator.sources import open_building

    rooms: dict[tuple[str, str, str], set[str]] = {}
    for home in TRAIN_HOMES:
        scene = open_building(home)
        named = scene.labels_by_id
        for thing in scene.instances:
            if thing.id in named and thing.room:
                rooms.setdefault((home, thing.floor, thing.room), set()).add(thing.label)
    return Cooccurrence.of_rooms(rooms.values())


if __name__ == "__main__":
    _PATH.write_text(count_train().to_json())
    print(f"wrote {_PATH}")
