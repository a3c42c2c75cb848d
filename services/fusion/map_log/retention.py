"""How far back the log is kept beyond what a restart needs, so that a source's views can be taken out of the maps again."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

_PARTS = 4  # the kept log is dropped in parts of this many; a snapshot is kept at each border


@dataclass(frozen=True, slots=True)
class Retention:
    """The largest part of the log that is kept: a number of views, and bytes of them."""

    views: int
    n_bytes: int


NO_RETENTION = Retention(0, 0)


def oldest_base(
    snapshots: Sequence[int], first: int, last: int, bytes_after: Callable[[int], int], retention: Retention
) -> int:
    """The log number from which on views are kept, which is that of a snapshot, or 0 for the empty maps.

    The log goes back to the older of the two newest snapshots at least.

    Args:
        snapshots: log number up to which each of two or more snapshots goes, oldest first.
        first, last: numbers of the oldest and the newest view in the log.
        bytes_after: size of the views after a number.
    """
    needed = snapshots[-2]
    for base in sorted({0, *snapshots}):
        if first - 1 <= base < needed and last - base <= retention.views and bytes_after(base) <= retention.n_bytes:
            return base
    return needed


def superfluous_snapshots(kept: Mapping[int, int], base: int, retention: Retention) -> list[int]:
    """The snapshots (ids of ``kept``, id -> log number, oldest first) that aren't needed if the log begins after ``base``.

    Needed are the two newest, the one at ``base``, and about one for each quarter of the log.
    """
    superfluous, previous, newest = [], base, {up_to: id for id, up_to in kept.items()}
    for id, up_to in list(kept.items())[:-2]:
        if id != newest[up_to]:  # after a removal, another one goes equally far
            superfluous.append(id)
        elif up_to == base or (up_to > base and up_to - previous >= retention.views // _PARTS > 0):
            previous = up_to
        else:
            superfluous.append(id)
    return superfluous
