"""Floors: who is there, and what the maps hold."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
from pydantic import BaseModel, Field

from surveilnav.messages import Revision
from surveilnav.sensing.layers import GRID_LAYERS
from surveilnav.services.gateway.core.resources.base import ROOT, Number, Resource


class FloorCamera(BaseModel):
    camera: str
    views_processed: int
    views: int


class Floor(Resource):
    id: str
    z_m: Number = Field(validation_alias="floor_z_m")
    revision: int | None = Field(description="null: nobody has mapped it yet")
    robots: list[str]
    cameras: list[str]
    invoked: list[FloorCamera]
    pending_views: int = 0
    perception_ok: bool | None = None
    message: str = ""
    layers: dict[str, str] = Field(description="where the pictures are")

    @classmethod
    def from_revision(
        cls,
        id: str,
        revision: Revision | None,
        robots: Sequence[str],
        cameras: Sequence[str],
        seen_ns: int | None,
        alive: bool,
        root: str = ROOT,
    ) -> Floor:
        """``robots`` and ``cameras`` say that they are there; the revision may not exist yet."""
        mapped = msgspec.structs.asdict(revision) if revision else {"floor_z_m": None, "revision": None, "cameras": []}
        facts = {
            "id": id,
            "robots": robots,
            "cameras": cameras,
            "invoked": mapped["cameras"],
            "layers": {name: f"{root}/floors/{id}/layers/{name}.png" for name in GRID_LAYERS},
            "last_seen": seen_ns,
            "stale": not alive,
        }
        return cls.model_validate(mapped | facts, from_attributes=True)
