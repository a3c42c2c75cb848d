"""The part of a building that one fusion service maps. A large building has several services, each with floors of its own."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.messages.recording import ONLY_FUSION


@dataclass(frozen=True, slots=True)
class Shard:
    """Some floors of a building, or all of them.

    Attributes:
        name: the id of the fusion service on the bus.
        floors: the floors' names; None: all floors.
    """

    name: str
    floors: frozenset[str] | None

    def includes(self, floor: str) -> bool:
        """Whether this part of the building has that floor."""
        return self.floors is None or floor in self.floors


#: Of the only fusion service of a building.
WHOLE_BUILDING = Shard(ONLY_FUSION, None)
