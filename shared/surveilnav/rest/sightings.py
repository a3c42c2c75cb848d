"""Where the cameras see something, without a robot."""

from __future__ import annotations

from datetime import datetime

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.rest import examples
from surveilnav.rest.base import Number


class SightingsRequest(BaseModel):
    """What all cameras are to look for."""

    model_config = ConfigDict(extra="forbid")

    target: str = Field(min_length=1, max_length=200, description="what to look for")
    floor: str | None = Field(default=None, description="only with the cameras of this floor")
    max_s: float = Field(default=10.0, ge=1.0, le=50.0, description="the answer comes after this time in any case")


class Sighting(BaseModel):
    """One thing that may be what was looked for."""

    floor: str
    object: int = Field(description="id of the object of the maps")
    label: str
    status: str = Field(description="confirmed or candidate")
    confidence: Number
    position_m: tuple[Number, Number, Number]
    room: str = Field(description="the room that it is in; empty: none that cameras.yaml names")
    position_sigma_m: Number = Field(description="standard deviation of the place; 0: a sensor measured it")
    last_seen: datetime | None
    sources: list[str]
    picture: str | None = Field(description="where a picture of it is, cut out around it; null: none is kept")


class SearchedCamera(BaseModel):
    """A camera that was looked at. ``lacking``: why not every view of it was; empty if every one was."""

    id: str
    views: int
    views_processed: int
    lacking: str


class SearchedRoom(BaseModel):
    """A room of cameras.yaml, and how much of it cameras see."""

    floor: str
    name: str
    in_view: Number = Field(
        description="the share of its free floor that cameras see; 0: what is there isn't seen by anybody"
    )
    cameras: list[str] = Field(description="the cameras that see part of it, the one that sees most first")


class Sightings(BaseModel):
    """Where cameras see something, the surest first."""

    model_config = ConfigDict(json_schema_extra={"example": examples.SIGHTINGS})

    target: str
    sightings: list[Sighting]
    cameras: list[SearchedCamera]
    rooms: list[SearchedRoom] = Field(description="the rooms of the searched floors, as far as cameras.yaml names them")
    complete: bool = Field(description="whether every view of every camera was looked at for the target")
