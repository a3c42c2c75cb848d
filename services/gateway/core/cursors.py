"""Pages of a list that grows at its head: a cursor names a place in it, whatever comes before that meanwhile."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Callable, Sequence
from typing import TypeVar

from surveilnav.contract import ID
from surveilnav.services.gateway.core.problems import Problem

T = TypeVar("T")
#: A list's order: the newest first, then by id.
Place = tuple[int, str]
_CURSOR = re.compile(rf"(\d{{1,20}})\.({ID})")


def page_after(
    rows: Sequence[T], place: Callable[[T], Place], cursor: str | None, offset: int, limit: int
) -> tuple[list[T], str | None]:
    """At most ``limit`` of the rows, which are sorted by ``place`` (minus a stamp, id), after a cursor or from ``offset``;
    and the cursor of the next page, None: there is none.

    Raises:
        Problem: the cursor is none (422).
    """
    begin = offset if cursor is None else bisect_right([place(r) for r in rows], _place_of(cursor))
    page = list(rows[begin : begin + limit])
    more = begin + limit < len(rows)
    return page, _cursor_of(place(page[-1])) if page and more else None


def _cursor_of(place: Place) -> str:
    return f"{-place[0]}.{place[1]}"


def _place_of(cursor: str) -> Place:
    match = _CURSOR.fullmatch(cursor)
    if match is None:
        raise Problem(422, "bad_cursor", "that is no cursor: take the `next` of the page before, or leave it out")
    return -int(match[1]), match[2]
