"""The building: its floors, map layers and objects."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.rest import examples
from surveilnav.rest.base import Number, Resource


class Building(Resource):
    """The building that this gateway serves."""

    id: str = Field(description="its name in every key on the bus")
    floors: list[str]
    cameras: int = Field(description="how many have announced themselves")
    robots: int = Field(description="how many have been heard of")
    missions: int = Field(description="how many are under way")
    ready: bool = Field(description="a mission could run now; /readyz says what is missing")


class FloorCamera(BaseModel):
    """A camera that the maps of a floor subscribe to, and how many of its views they have."""

    camera: str
    views_processed: int
    views: int


class Floor(Resource):
    """A floor: who is there, and what its maps hold."""

    id: str
    z_m: Number
    revision: int | None = Field(description="null: nobody has mapped it yet")
    robots: list[str]
    cameras: list[str]
    invoked: list[FloorCamera]
    pending_views: int = 0
    perception_ok: bool | None = None
    message: str = ""
    layers: dict[str, str] = Field(description="where the pictures are")


class Area(Resource):
    """A keepout zone, where no robot is sent, or a door or a lift, which robots pass while it is open."""

    id: str = Field(description="floor/kind/name")
    floor: str
    name: str
    kind: Literal["keepout", "door", "lift"]
    state: Literal["open", "closed", "unknown"] | None = Field(
        description="of a passage; unknown: nothing was said of it lately, and what the map says counts; null: it is a zone"
    )
    outline_m: list[tuple[float, float]] = Field(description="corners (x, y) in the world frame")


class Layer(BaseModel):
    """A map layer: where it lies in the world."""

    floor: str
    layer: str
    target: str = Field(
        description="whose value it shows; empty for the other layers, and where the newest mission's is shown"
    )
    revision: int
    rows: int
    cols: int
    resolution_m: float
    T_world_cell: list[list[float]] = Field(
        description="3 x 3: maps (column, row, 1) of a cell to (x, y, 1) of its centre [m]; row 0 is the southernmost"
    )
    low: Number = Field(description="the lowest value; null for other layers")
    high: Number
    views_left_out: int = Field(description="how many views it leaves out because another model looked at them")
    picture: str = Field(description="where it is as PNG, north up")
    array: str = Field(description="where it is as numpy's .npy")


class ObjectEvent(BaseModel):
    """Something that happened to an object: a view saw it, or a rule decided about it."""

    time: datetime | None
    source: str
    view: int
    seq: int
    label: str
    score: Number
    what: str
    note: str
    box_px: list[Number] | None


class Object(Resource):
    """An object of the joint map."""

    model_config = ConfigDict(json_schema_extra={"example": examples.OBJECT})

    id: int
    floor: str
    label: str
    status: str
    reason: str
    confidence: Number
    confidence_robot: Number
    confidence_surveillance: Number
    label_robot: str
    label_surveillance: str
    n_detections: int
    n_points: int
    center_m: tuple[Number, Number, Number]
    size_m: tuple[Number, Number, Number]
    position_sigma_m: Number = Field(
        default=0.0, description="standard deviation of its place while that is only estimated; 0: a sensor measured it"
    )
    first_seen: datetime | None
    sources: list[str]
    relevance: Number | None = Field(default=None, description="how well it fits the text asked for, -1 to 1")
    history: list[ObjectEvent]
