"""What all resources share: when the gateway last heard of them, pages of lists, and types that remote data can't break."""

from __future__ import annotations

import math
from datetime import datetime
from typing import Annotated, Generic, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

T = TypeVar("T")
#: The path that all resources lie below; the addresses in answers begin with it.
ROOT = "/api/v1"
#: The ids that can be part of an address, as a regular expression; the same as ``surveilnav.contract.ID_PATTERN``.
ID_PATTERN = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"


def finite(value: float | None) -> float | None:
    """The number, or None where it isn't finite: JSON has no word for that."""
    return value if value is not None and math.isfinite(value) else None


#: A number that remote data may have spoiled: null where it isn't finite.
Number = Annotated[float | None, BeforeValidator(finite)]
#: A text that is null where it is empty.
Text = Annotated[str | None, BeforeValidator(lambda text: text or None)]


class Resource(BaseModel):
    """Something that the gateway hears of from its owner, who may leave or fall silent."""

    model_config = ConfigDict(json_schema_serialization_defaults_required=True)  # answers have every field

    last_seen: datetime | None = Field(default=None, description="when the gateway last heard of it; null: never")
    stale: bool = Field(description="its owner is gone, or it is older than the contract allows")


class Items(BaseModel, Generic[T]):
    """One page of a list: at most ``limit`` items from ``offset``. ``total`` is the length of the whole list."""

    items: list[T]
    total: int


class GrowingItems(Items[T], Generic[T]):
    """One page of a list that grows at its head; with ``next``, pages don't shift while it grows."""

    next: str | None = Field(description="the `cursor` of the next page; null: this is the last one")
