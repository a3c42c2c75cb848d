"""Cameras, their views, and who was shown them."""

from __future__ import annotations

from datetime import datetime

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.rest import examples
from surveilnav.rest.base import Number, Resource


class CameraView(BaseModel):
    """One of the directions that a camera looks in."""

    view: int
    yaw_rad: float | None = Field(
        description="azimuth of the optical axis, anticlockwise from +x; null: looks straight down"
    )
    pitch_rad: float
    picture: str = Field(description="where a thumbnail is; each request costs the camera one view of traffic")


class CameraCone(BaseModel):
    """The part of its floor that a view shows."""

    view: int
    outline_m: list[tuple[float, float]] = Field(
        description="(x, y) of the corners of the area of floor in the picture, at most 5 m away; walls aren't considered"
    )


class CameraStream(BaseModel):
    """What the stream of a camera's pictures is doing. A simulated camera's is always live."""

    state: str = Field(description="connecting, live, no_frames, frozen, black, grey, garbled, moved or failed")
    reason: str = Field(description="details; empty while it is live")
    since: datetime | None = Field(description="when the state began; null: always")
    n_bytes: int = Field(
        default=0,
        description="bytes that came from the camera since its node started; they travel beside the bus and aren't part of any "
        "other number",
    )


class Camera(Resource):
    """A surveillance camera as it announced itself, and what came of its views."""

    model_config = ConfigDict(json_schema_extra={"example": examples.CAMERA})

    id: str
    floor: str
    position_m: tuple[float, float, float]
    mounting_offset_m: Number
    hfov_rad: float
    width_px: int
    height_px: int
    tier: str
    label: str = Field(default="", description="its name for people; empty: as `id`")
    stream: CameraStream = Field(description="what the stream of its pictures is doing")
    paused: bool = Field(description="a person had it show nothing")
    invoked: bool = Field(description="the maps of its floor subscribe to it")
    views_processed: int = Field(
        default=0, description="how many of its views are in the maps, or were refused for good"
    )
    quarantine: str = Field(
        default="", description="why none of its views is believed, until it is described anew; empty: they are"
    )
    labels: dict[str, Number] = Field(default_factory=dict, description="what it last saw, with confidences")
    views: list[CameraView]


class AccessRecord(BaseModel):
    """A client was shown a view of a camera. One that keeps watching is recorded once a minute."""

    time: datetime
    client: str = Field(description="the client's address")
    key: str = Field(default="", description="the name of the client's key; empty: no key was needed")
    view: int = Field(description="-1: all of them")
    what: str = Field(description="thumbnail, latest, tile, history (of an object) or recording")


class PictureKeeper(BaseModel):
    """A service that keeps past pictures, and what it answered when it was asked to forget them."""

    keeper: str
    message: str
