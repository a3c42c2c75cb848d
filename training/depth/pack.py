"""Packed views: one file per building, written atomically (``surveilnav.storage``).

Parts: a table in JSON, then for each view its picture (WebP) and its depth (float16, compressed).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import cv2
import msgspec
import numpy as np
import zstandard
from numpy.typing import NDArray

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.storage import read_parts, write_parts

SUFFIX = ".depth-views"
_FORMAT = b"surveilnav depth views 1"
_QUALITY = 90


class ViewGeometry(msgspec.Struct, frozen=True):
    """Where a view was taken from.

    Attributes:
        hfov_rad: horizontal field of view.
        height_m: of the camera over its floor.
        pitch_rad: above 0 looks up. ``roll_rad``: turns the camera around its optical axis.
        planned: whether the pose is of the camera plan's kind.
    """

    hfov_rad: float
    height_m: float
    pitch_rad: float
    roll_rad: float
    planned: bool

    def camera(self, side_px: int) -> Pinhole:
        """Intrinsics of the square picture."""
        return Pinhole.from_hfov(side_px, side_px, self.hfov_rad)

    def pose(self) -> Matrix4:
        """(4, 4) ``T_floor_camera``, the camera's pose in a frame on the floor below it, z up, x in the direction of view [m]."""
        return rolled(camera_pose((0.0, 0.0, self.height_m), 0.0, self.pitch_rad), self.roll_rad)


def rolled(T_world_camera: Matrix4, roll_rad: float) -> Matrix4:
    """A pose (4, 4) turned around the camera's optical axis."""
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    T_camera_rolled = np.eye(4)
    T_camera_rolled[:2, :2] = [[c, -s], [s, c]]
    return T_world_camera @ T_camera_rolled


@dataclass(frozen=True, slots=True, eq=False)
class DepthView:
    """One training view.

    Attributes:
        geometry: where it was taken from.
        rgb: (S, S, 3) uint8.
        depth_m: (S, S) float16 [m] along the optical axis, without noise; 0: nothing was hit.
    """

    geometry: ViewGeometry
    rgb: NDArray[np.uint8]
    depth_m: NDArray[np.float16]


class _Table(msgspec.Struct, frozen=True):
    scene: str
    side_px: int
    views: list[ViewGeometry]


@dataclass(frozen=True, slots=True, eq=False)
class Pack:
    """The views of one building, still encoded."""

    scene: str
    side_px: int
    views: tuple[ViewGeometry, ...]
    pictures: tuple[bytes, ...]
    depths: tuple[bytes, ...]

    def view(self, i: int) -> DepthView:
        """View ``i``, decoded."""
        bgr = cv2.imdecode(np.frombuffer(self.pictures[i], np.uint8), cv2.IMREAD_COLOR)
        assert bgr is not None
        depth_m = np.frombuffer(zstandard.decompress(self.depths[i]), np.float16)
        rgb = np.ascontiguousarray(bgr[..., ::-1]).astype(np.uint8)
        return DepthView(self.views[i], rgb, depth_m.reshape(self.side_px, self.side_px))


def write_pack(path: Path, scene: str, side_px: int, views: Iterable[DepthView]) -> int:
    """Writes a building's views of ``side_px`` x ``side_px`` pixels; returns the size of the file in bytes."""
    rows: list[ViewGeometry] = []
    parts: list[bytes] = []
    for view in views:
        done, data = cv2.imencode(".webp", view.rgb[..., ::-1].copy(), [cv2.IMWRITE_WEBP_QUALITY, _QUALITY])
        assert done
        rows.append(view.geometry)
        parts += [data.tobytes(), zstandard.compress(view.depth_m.tobytes(), 3)]
    return write_parts(path, _FORMAT, [msgspec.json.encode(_Table(scene, side_px, rows)), *parts])


def read_packs(folder: Path) -> list[Pack]:
    """All packs of a folder, by name.

    Raises:
        PerceptionError: there is none.
    """
    packs = [pack for path in sorted(folder.glob(f"*{SUFFIX}")) if (pack := _read_pack(path)) is not None]
    if not packs:
        raise PerceptionError(f"{folder} has no file *{SUFFIX}: make them with python -m training.depth.make_views")
    return packs


def _read_pack(path: Path) -> Pack | None:
    parts = read_parts(path, _FORMAT)
    if parts is None:
        return None
    table = msgspec.json.decode(parts[0], type=_Table)
    return Pack(table.scene, table.side_px, tuple(table.views), tuple(parts[1::2]), tuple(parts[2::2]))
