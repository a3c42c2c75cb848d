"""Ids in addresses, and lists in pages."""

from __future__ import annotations

from typing import Annotated, TypeVar

from fastapi import Path, Query

from surveilnav.contract import ID_PATTERN
from surveilnav.services.gateway.core.resources import Items

T = TypeVar("T")
Id = Annotated[str, Path(pattern=ID_PATTERN)]
Limit = Annotated[int, Query(ge=1, le=1000)]
Offset = Annotated[int, Query(ge=0)]


def page_of(everything: list[T], limit: int, offset: int) -> Items[T]:
    """At most ``limit`` items from ``offset``."""
    return Items(items=everything[offset : offset + limit], total=len(everything))
