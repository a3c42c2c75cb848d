"""Who saw what: sets of sources under small numbers, so that a voxel can keep its set in four bytes."""

from __future__ import annotations

from collections.abc import Sequence

#: More different sets than this are not told apart: a set beyond it is ``MANY``.
MAX_SETS = 1 << 16
MANY = "many"


class SourceSets:
    """Sets of source names, numbered from 0, the empty set, in the order in which they came up.

    A set stands for what it holds, so any two ways to build it give the same number. Once ``MAX_SETS`` are known
    every new one is called ``[MANY]``, which stays what it is whoever joins it.
    """

    def __init__(self) -> None:
        self._sets: list[tuple[str, ...]] = [()]
        self._number: dict[tuple[str, ...], int] = {(): 0}
        self._joined: dict[tuple[int, str], int] = {}

    def __len__(self) -> int:
        return len(self._sets)

    def join(self, number: int, source: str) -> int:
        """The number of the set ``number`` with ``source`` in it."""
        joined = self._joined.get((number, source))
        if joined is None:
            members = self._sets[number]
            joined = number if members == (MANY,) else self._intern(tuple(sorted({*members, source})))
            if len(self._joined) >= 8 * MAX_SETS:  # only a shortcut: it may be forgotten
                self._joined.clear()
            self._joined[number, source] = joined
        return joined

    def lists(self) -> list[list[str]]:
        """All sets, by number."""
        return [list(members) for members in self._sets]

    @classmethod
    def from_lists(cls, lists: Sequence[Sequence[str]]) -> SourceSets:
        """The sets that ``lists`` tells of."""
        sets = cls()
        sets._sets = [tuple(members) for members in lists]
        sets._number = {members: i for i, members in enumerate(sets._sets)}
        return sets

    def _intern(self, members: tuple[str, ...]) -> int:
        if members not in self._number:
            if len(self._sets) >= MAX_SETS - 1:
                members = (MANY,)
                if members in self._number:
                    return self._number[members]
            self._number[members] = len(self._sets)
            self._sets.append(members)
        return self._number[members]
