"""What all resources share: when they were last heard of, pages of lists, and values that remote data can't break."""

from __future__ import annotations

import math
from dataclasses import asdict
from datetime import UTC, datetime
from typing import Annotated, Any, Generic, TypeVar

import msgspec
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

T = TypeVar("T")
R = TypeVar("R", bound="Resource")
#: Below it lie all resources; the addresses in answers begin with it.
ROOT = "/api/v1"


def finite(value: float | None) -> float | None:
    """The number; None for what isn't finite, which JSON can't carry."""
    return value if value is not None and math.isfinite(value) else None


def utc(stamp_ns: int | None) -> datetime | None:
    """The time of a stamp [ns since the epoch]; None for 0 and for stamps that are no time of ours."""
    if not stamp_ns:
        return None
    try:
        return datetime.fromtimestamp(stamp_ns / 1e9, UTC)
    except (OverflowError, ValueError, OSError):
        return None


#: Null where it isn't finite.
Number = Annotated[float | None, BeforeValidator(finite)]
#: UTC, made from a stamp [ns]; null where there is none.
Time = Annotated[datetime | None, BeforeValidator(utc)]
#: Null where it is empty.
Text = Annotated[str | None, BeforeValidator(lambda text: text or None)]


class Resource(BaseModel):
    model_config = ConfigDict(json_schema_serialization_defaults_required=True)  # answers have every field

    last_seen: Time = Field(default=None, description="when the gateway last heard of it")
    stale: bool = Field(description="its owner is gone, or it is older than the contract allows")

    @classmethod
    def made_of(cls: type[R], message: Any, **facts: object) -> R:
        """The fields of ``message`` (a struct or a dataclass) by name or alias; ``facts`` stand before them."""
        known = msgspec.structs.asdict(message) if isinstance(message, msgspec.Struct) else asdict(message)
        return cls.model_validate(known | facts, from_attributes=True)


class Items(BaseModel, Generic[T]):
    """A list: at most ``limit`` items from ``offset``; ``total`` says how many there are."""

    items: list[T]
    total: int


class GrowingItems(Items[T], Generic[T]):
    """A list that grows at its head, in pages that don't shift meanwhile."""

    next: str | None = Field(description="the `cursor` of the next page; null: there is none")
