"""A fisheye picture of a simulated building, as a camera on the ceiling takes it that looks straight down."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_plan import PlannedCamera
from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.geometry.lens import KannalaBrandt
from surveilnav.simulator.simulation import SimulatedBuilding

#: The picture, of which the circle is the lower half space.
SIDE_PX, HFOV_DEG = 1536, 180.0
#: Four pinhole views at this pitch, each as wide as this, show all directions below the horizon.
_PITCH_RAD, VIEW = math.radians(-45.0), Pinhole.from_hfov(1280, 1280, math.radians(112.0))
_NOISE_SIGMA = 3.0


def lens() -> KannalaBrandt:
    """An equidistant lens that sees half of all directions."""
    focal_px = SIDE_PX / math.radians(HFOV_DEG)
    centre_px = (SIDE_PX - 1) / 2
    pinhole = Pinhole(SIDE_PX, SIDE_PX, focal_px, focal_px, centre_px, centre_px)
    return KannalaBrandt(pinhole, max_angle_rad=math.radians(HFOV_DEG / 2))


def render(building: SimulatedBuilding, camera: PlannedCamera) -> NDArray[np.uint8]:
    """(SIDE_PX, SIDE_PX, 3) what a fisheye camera sees in place of a camera of the plan; black outside of its circle."""
    views = [(pose, _view(building, pose)) for pose in poses(camera.position_m)]
    return join(views, camera_pose(camera.position_m, 0.0, -math.pi / 2))


def poses(position_m: tuple[float, float, float]) -> list[Matrix4]:
    """``T_world_view`` of the pinhole views that a picture is made of."""
    return [camera_pose(position_m, math.pi / 2 * quarter, _PITCH_RAD) for quarter in range(4)]


def join(views: list[tuple[Matrix4, NDArray[np.uint8]]], T_world_lens: Matrix4) -> NDArray[np.uint8]:
    """The fisheye picture from pinhole views at the same place.

    Args:
        views: ``T_world_view`` and picture; each direction is taken from the view that has it nearest to its middle.
    """
    rows, cols = np.mgrid[:SIDE_PX, :SIDE_PX]
    rays_world = lens().rays(np.stack([cols, rows], axis=-1).astype(np.float64)) @ T_world_lens[:3, :3].T
    nearest = np.stack([rays_world @ pose[:3, 2] for pose, _ in views]).argmax(axis=0)
    picture = np.zeros((SIDE_PX, SIDE_PX, 3), np.uint8)
    for number, (pose, rgb) in enumerate(views):
        mine = (nearest == number) & np.isfinite(rays_world).all(axis=-1)
        rays = rays_world @ pose[:3, :3]
        u = VIEW.fx_px * rays[..., 0] / rays[..., 2] + VIEW.cx_px
        v = VIEW.fy_px * rays[..., 1] / rays[..., 2] + VIEW.cy_px
        part = cv2.remap(
            rgb, u.astype(np.float32), v.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        picture[mine] = part[mine]
    return picture


def jpegs(picture: NDArray[np.uint8], n: int, seed: int) -> list[bytes]:
    """n JPEGs of one still picture, each with a sensor's noise of its own."""
    rng, out = np.random.default_rng(seed), []
    for _ in range(n):
        noisy = picture + rng.normal(0.0, _NOISE_SIGMA, picture.shape[:2])[..., None]
        bgr = cv2.cvtColor(np.clip(noisy, 0, 255).astype(np.uint8), cv2.COLOR_RGB2BGR)
        out.append(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes())
    return out


def _view(building: SimulatedBuilding, T_world_view: Matrix4) -> NDArray[np.uint8]:
    rendered = building.views.get_or_render(
        lambda: building.renderer,
        building.plan.scene_hash,
        T_world_view,
        VIEW,
        lighting=building.settings.lighting,  # type: ignore[arg-type]
    )
    return rendered.rgb
