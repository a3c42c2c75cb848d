"""Byte ranges of a download (RFC 9110, section 14): one at a time."""

from __future__ import annotations

import re

from surveilnav.services.gateway.core.problems import Problem

_RANGE = re.compile(r"bytes=(\d{0,18})-(\d{0,18})")


def part_of(header: str, total: int) -> tuple[int, int] | None:
    """(first byte, byte after the last) that ``Range`` asks for of ``total`` bytes; None: all of them, as for several ranges at
    once or another unit.

    Raises:
        Problem: nothing of the file lies there (416).
    """
    match = _RANGE.fullmatch(header.strip())
    if match is None or match[1] == match[2] == "":
        return None
    if match[1] == "":  # the last so many
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
