"""Which recordings go, so that those that are kept stay within their limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Kept:
    """A file in the folder. ``ended_ns``: when it last changed. ``open``: somebody writes it."""

    id: str
    n_bytes: int
    ended_ns: int
    open: bool = False


@dataclass(frozen=True, slots=True)
class Limits:
    """``n_bytes``: of all files, those that are being written among them. ``age_ns``: since a file last changed. 0: none."""

    n_bytes: int
    age_ns: int


def to_delete(files: Iterable[Kept], limits: Limits, now_ns: int) -> list[str]:
    """The ids of those that must go, the oldest first; never one that is being written."""
    files = sorted(files, key=lambda f: (f.ended_ns, f.id))
    total = sum(f.n_bytes for f in files)
    going = []
    for file in files:
        if file.open:
            continue
        too_old = limits.age_ns > 0 and now_ns - file.ended_ns > limits.age_ns
        too_many = 0 < limits.n_bytes < total
        if too_old or too_many:
            going.append(file.id)
            total -= file.n_bytes
    return going
