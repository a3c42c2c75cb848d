"""What the parts of fusion's settings have in common."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class ConfigPart(BaseModel):
    """A part of the settings; it can't be changed, and knows its entries."""

    model_config = ConfigDict(frozen=True, extra="forbid")
