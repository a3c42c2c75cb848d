"""Cameras and their views."""

from __future__ import annotations

import math
from datetime import datetime
from functools import lru_cache

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.geometry import Pose
from surveilnav.messages import CameraInfo, CameraUse, CameraViewInfo
from surveilnav.services.gateway.core.resources import examples
from surveilnav.services.gateway.core.resources.base import ROOT, Number, Resource, finite


class CameraView(BaseModel):
    view: int
    yaw_rad: float | None = Field(
        description="azimuth of the optical axis, anticlockwise from +x; null: looks straight down"
    )
    pitch_rad: float
    picture: str = Field(description="where a thumbnail is; each request costs the camera one view of traffic")

    @classmethod
    def from_info(cls, camera: str, info: CameraViewInfo, root: str = ROOT) -> CameraView:
        """A view of ``camera``: where its optical axis points in the world. ``root``: where addresses begin."""
        axis = _optical_axis(info.T_world_camera)
        level = math.hypot(axis[0], axis[1])
        return cls(
            view=info.view,
            yaw_rad=math.atan2(axis[1], axis[0]) if level > 1e-3 else None,
            pitch_rad=math.atan2(axis[2], level),
            picture=f"{root}/cameras/{camera}/views/{info.view}.jpg",
        )


@lru_cache(maxsize=50_000)  # every reader asks for every camera
def _optical_axis(T_world_camera: Pose) -> tuple[float, float, float]:
    x, y, z = T_world_camera.matrix()[:3, 2].tolist()
    return x, y, z


class CameraCone(BaseModel):
    """What of its floor a view looks at."""

    view: int
    outline_m: list[tuple[float, float]] = Field(
        description="(x, y) of the corners of the stretch of floor in the picture, at most 5 m off; walls aren't known here"
    )


class CameraLook(BaseModel):
    """Somebody was shown a view. Who goes on looking is noted once a minute."""

    time: datetime
    client: str = Field(description="the address of who looked")
    view: int = Field(description="-1: all of them")
    what: str = Field(description="thumbnail, latest, tile, history (of an object) or recording")


class PictureKeeper(BaseModel):
    """Who kept past pictures, and what it does to forget them."""

    keeper: str
    message: str


class Camera(Resource):
    model_config = ConfigDict(json_schema_extra={"example": examples.CAMERA})

    id: str = Field(validation_alias="camera")
    floor: str
    position_m: tuple[float, float, float]
    mounting_offset_m: Number
    hfov_rad: float
    width_px: int
    height_px: int
    tier: str
    paused: bool = Field(description="a person has it show nothing")
    invoked: bool = Field(description="the maps of its floor subscribe to it")
    views_processed: int = Field(default=0, description="how many of its views the maps hold or have refused for good")
    labels: dict[str, Number] = Field(default_factory=dict, description="what it last saw, with confidences")
    views: list[CameraView]

    @classmethod
    def from_info(
        cls,
        info: CameraInfo,
        use: CameraUse | None,
        labels: dict[str, float],
        seen_ns: int,
        alive: bool,
        root: str = ROOT,
    ) -> Camera:
        """A camera as it announced itself. ``use``: what fusion has processed of it; ``labels``: its newest summary."""
        return cls.made_of(
            info,
            position_m=tuple(finite(v) or 0.0 for v in info.position_m),
            hfov_rad=info.intrinsics.hfov_rad,
            width_px=info.intrinsics.width_px,
            height_px=info.intrinsics.height_px,
            invoked=use is not None,
            views_processed=use.views_processed if use else 0,
            labels=labels,
            views=[CameraView.from_info(info.camera, view, root) for view in info.views],
            last_seen=seen_ns,
            stale=not alive,
        )
