"""Which recordings go, so that those that are kept stay within their limits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Kept:
    """A file in the folder. ``started_ns``: since when it holds pictures. ``open``: somebody writes it. ``changed_ns``: when
    that was last."""

    id: str
    n_bytes: int
    started_ns: int
    open: bool = False
    changed_ns: int = 0


@dataclass(frozen=True, slots=True)
class Limits:
    """``n_bytes``: of all files, those that are being written among them. ``age_ns``: since a recording began. 0: none."""

    n_bytes: int
    age_ns: int


def to_delete(files: Iterable[Kept], limits: Limits, now_ns: int) -> list[str]:
    """The ids of those that must go, the oldest first; never one that is being written."""
    files = sorted(files, key=lambda f: (f.started_ns, f.id))
    total = sum(f.n_bytes for f in files)
    going = []
    for file in files:
        if file.open:
            continue
        too_old = limits.age_ns > 0 and now_ns - file.started_ns > limits.age_ns
        too_many = 0 < limits.n_bytes < total
        if too_old or too_many:
            going.append(file.id)
            total -= file.n_bytes
    return going
