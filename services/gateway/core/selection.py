"""Which part of something is asked for: objects by a filter, a page of a list by a cursor, a range of a file's bytes."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from surveilnav.contract import ID
from surveilnav.messages import ObjectRecord
from surveilnav.nouns import thing_asked_for
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.words import canonical

T = TypeVar("T")
#: The key by which a growing list is sorted: (minus the time stamp, id), so the newest comes first.
SortKey = tuple[int, str]
_CURSOR = re.compile(rf"(\d{{1,20}})\.({ID})")
_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")


@dataclass(frozen=True, slots=True)
class ObjectFilter:
    """Which objects are wanted; None and 0 leave a field open. ``label`` may be in any spelling or language."""

    floor: str | None = None
    label: str | None = None
    status: str | None = None
    min_confidence: float = 0.0

    def apply(self, records: Iterable[ObjectRecord]) -> list[ObjectRecord]:
        """The wanted objects: those with a ``relevance`` first, the highest first; then by floor, the last seen first."""
        found = [r for r in records if self._matches(r)]
        found.sort(key=lambda r: (r.floor, -r.last_seen_ns, r.id))
        return sorted(found, key=lambda r: (r.relevance is None, -(r.relevance or 0.0)))

    def _matches(self, record: ObjectRecord) -> bool:
        return (
            (self.floor is None or record.floor == self.floor)
            and (self.label is None or record.label in {canonical(self.label), thing_asked_for(self.label)})
            and (self.status is None or record.status == self.status)
            # a confidence of NaN is none
            and (not self.min_confidence or record.confidence >= self.min_confidence)
        )


def page_after(
    rows: Sequence[T], sort_key: Callable[[T], SortKey], cursor: str | None, offset: int, limit: int
) -> tuple[list[T], str | None]:
    """A page of a list that is sorted by ``sort_key``.

    A cursor names a place in the list by the last row before it, so pages don't shift when newer rows come.

    Args:
        cursor: begin after that place; None: begin at ``offset``.
        offset: how many rows to skip, where there is no cursor.
        limit: the most rows of a page.

    Returns:
        The rows, and the cursor of the next page (None: this is the last one).

    Raises:
        Problem: the cursor is none (422).
    """
    begin = offset if cursor is None else bisect_right([sort_key(r) for r in rows], _key_in(cursor))
    page = list(rows[begin : begin + limit])
    more = begin + limit < len(rows)
    return page, _cursor_at(sort_key(page[-1])) if page and more else None


def _cursor_at(key: SortKey) -> str:
    return f"{-key[0]}.{key[1]}"


def _key_in(cursor: str) -> SortKey:
    match = _CURSOR.fullmatch(cursor)
    if match is None:
        raise Problem(422, "bad_cursor", "that is no cursor: take the `next` of the page before, or leave it out")
    return -int(match[1]), match[2]


def byte_range(header: str, total: int) -> tuple[int, int] | None:
    """What a ``Range`` header asks for of a file of ``total`` bytes (RFC 9110, section 14).

    Returns:
        (first byte, byte after the last). None means the whole file: several ranges at once and other units are ignored, as
        the RFC allows.

    Raises:
        Problem: no byte of the file lies in that range (416).
    """
    match = _RANGE.fullmatch(header.strip())
    if match is None or match[1] == match[2] == "":
        return None
    if match[1] == "":  # the last so many bytes
        first, after = max(0, total - int(match[2])), total
    else:
        first, after = int(match[1]), min(int(match[2]) + 1 if match[2] else total, total)
        if match[2] and int(match[2]) < first:
            return None
    if first >= after:
        raise Problem(
            416, "no_such_range", f"the file has {total} bytes, and none of them lies in {header.strip()!r:.60}"
        )
    return first, after
