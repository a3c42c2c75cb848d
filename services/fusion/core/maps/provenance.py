"""Provenance: sets of sources under small numbers, so that a voxel can store who has seen it in four bytes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

#: At most so many different sets are told apart; any further one becomes ``[MANY]``.
MAX_SETS = 1 << 16
MANY = "many"


@dataclass(frozen=True, slots=True)
class Agreement:
    """How far what a source has measured agrees with what others have seen, in voxels.

    Attributes:
        n_refuted: nobody but the source has seen something there, and later views look through it.
        n_confirmed: others have seen something there, too.
    """

    n_refuted: int = 0
    n_confirmed: int = 0

    @property
    def refuted_share(self) -> float:
        return self.n_refuted / max(1, self.n_refuted + self.n_confirmed)


class SourceSets:
    """Sets of source names, numbered in the order of their creation. Number 0 is the empty set.

    Equal sets have the same number, however they came about. Once ``MAX_SETS`` exist, every new set is ``[MANY]``, and adding
    a source to ``[MANY]`` doesn't change it.
    """

    def __init__(self) -> None:
        self._sets: list[tuple[str, ...]] = [()]
        self._numbers: dict[tuple[str, ...], int] = {(): 0}
        self._with_source: dict[tuple[int, str], int] = {}

    def __len__(self) -> int:
        return len(self._sets)

    def with_source(self, number: int, source: str) -> int:
        """The number of the set that contains the members of set ``number`` and ``source``."""
        found = self._with_source.get((number, source))
        if found is None:
            members = self._sets[number]
            found = number if members == (MANY,) else self._number_of(tuple(sorted({*members, source})))
            if len(self._with_source) >= 8 * MAX_SETS:  # it is only a cache
                self._with_source.clear()
            self._with_source[number, source] = found
        return found

    def lists(self) -> list[list[str]]:
        """The sorted members of all sets, by number."""
        return [list(members) for members in self._sets]

    @classmethod
    def from_lists(cls, lists: Sequence[Sequence[str]]) -> SourceSets:
        """The sets that ``lists`` returned."""
        sets = cls()
        sets._sets = [tuple(members) for members in lists]
        sets._numbers = {members: i for i, members in enumerate(sets._sets)}
        return sets

    def _number_of(self, members: tuple[str, ...]) -> int:
        if members not in self._numbers:
            if len(self._sets) >= MAX_SETS - 1:
                members = (MANY,)
                if members in self._numbers:
                    return self._numbers[members]
            self._numbers[members] = len(self._sets)
            self._sets.append(members)
        return self._numbers[members]
