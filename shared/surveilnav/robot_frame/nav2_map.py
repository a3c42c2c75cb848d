"""Nav2's map of a floor: which cells are free, which are occupied, and which nobody has seen.

It comes from ``map.yaml`` and its picture, or from the topic ``/map`` (``nav_msgs/OccupancyGrid``). What a pixel means is as in
Nav2's map_server (https://docs.nav2.org/configuration/packages/configuring-map-server.html), with one exception. map_saver draws
unknown cells in the grey 205, and by its own default of ``free_thresh``, 0.25, map_server then reads them as free. Here this grey
is unknown.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from pydantic import Field, field_validator, model_validator

from surveilnav.camera_pose.floor_plan import PlanFile, read_plan_file, read_plan_picture
from surveilnav.errors import ConfigError
from surveilnav.geometry import Grid, Pose
from surveilnav.robot_frame.planar import PlanarTransform

#: What a cell is.
UNKNOWN, FREE, OCCUPIED = 0, 1, 2
#: A map of 350 x 350 m at 5 cm. A picture of more pixels isn't even opened: a few kilobytes may be a picture of gigabytes.
MAX_CELLS = 50_000_000
_MIN_RESOLUTION_M, _MAX_RESOLUTION_M, _MAX_ORIGIN_M = 0.005, 1.0, 1e5
#: From these probabilities [%] on, a cell counts as occupied, or up to them as free (map_saver's defaults).
_OCCUPIED_PERCENT, _FREE_PERCENT = 65, 25
_UNKNOWN_GREY = 205
_MAX_TILT_RAD = math.radians(1.0)


@dataclass(frozen=True, slots=True, eq=False)
class Nav2Map:
    """A robot's map of one floor.

    Attributes:
        cells: (rows, cols) uint8, ``UNKNOWN``, ``FREE`` or ``OCCUPIED``. Rows grow with y of the frame of the cells.
        resolution_m: side of a cell.
        T_map_cells: pose of the outer corner of cell (0, 0) in the robot's map.
    """

    cells: NDArray[np.uint8]
    resolution_m: float
    T_map_cells: PlanarTransform = field(default_factory=PlanarTransform)

    def places(self, kind: int) -> NDArray[np.float64]:
        """(n, 2) centres of the cells of a kind, in the robot's map [m]."""
        rows, cols = np.nonzero(self.cells == kind)
        return self.T_map_cells.apply((np.stack([cols, rows], axis=-1) + 0.5) * self.resolution_m)

    def on_grid(self, grid: Grid, T_building_map: PlanarTransform) -> NDArray[np.uint8]:
        """The map on a grid of the building, (rows, cols) uint8; ``UNKNOWN`` outside of it.

        A cell has the kind of the map's cell at its centre. It is occupied, too, if the centre of an occupied cell lies in it, so
        that a thin wall gets no holes where the map is turned or finer than the grid.
        """
        rows, cols = np.mgrid[: grid.rows, : grid.cols]
        T_cells_building = (T_building_map @ self.T_map_cells).inverse()
        p = T_cells_building.apply(grid.centres_of(np.stack([rows, cols], axis=-1))) / self.resolution_m
        col, row = np.floor(p).astype(np.int64).transpose(2, 0, 1)
        inside = (row >= 0) & (row < self.cells.shape[0]) & (col >= 0) & (col < self.cells.shape[1])
        out = np.full(grid.shape, UNKNOWN, np.uint8)
        out[inside] = self.cells[row[inside], col[inside]]
        walls = grid.cells_of(T_building_map.apply(self.places(OCCUPIED)))
        walls = walls[grid.contains(walls)]
        out[walls[:, 0], walls[:, 1]] = OCCUPIED
        return out

    def extent(self, T_building_map: PlanarTransform) -> tuple[float, float, float, float]:
        """(x0, y0, x1, y1) [m] of the smallest rectangle along the building's axes around the map."""
        height, width = (n * self.resolution_m for n in self.cells.shape)
        corners = (T_building_map @ self.T_map_cells).apply([(0, 0), (width, 0), (0, height), (width, height)])
        (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)

    @classmethod
    def from_message(
        cls, width: int, height: int, resolution_m: float, origin: Pose, data: NDArray[np.int8] | list[int]
    ) -> Nav2Map:
        """The map of a ``nav_msgs/OccupancyGrid``.

        Args:
            data: (height * width,), row by row from the lowest: probability of being occupied [%], -1 where unknown.

        Raises:
            ConfigError: the parts don't fit each other, or no floor has such a map.
        """
        _check_size(width, height, resolution_m, "the robot's map")
        values = np.asarray(data)
        if values.shape != (height * width,):
            raise ConfigError(
                f"the robot's map says that it is {width} x {height} cells, and has {values.size} of them"
            )
        R = origin.matrix()
        if math.acos(min(1.0, float(R[2, 2]))) > _MAX_TILT_RAD:
            raise ConfigError("the robot's map leans: its origin is turned about another axis than the vertical")
        T_map_cells = PlanarTransform.from_matrix(R)
        _check_origin(T_map_cells.x_m, T_map_cells.y_m, "the robot's map")
        percent = values.reshape(height, width).astype(np.int16)
        return cls(_kinds(percent), resolution_m, T_map_cells)


class _MapFile(PlanFile):
    """All entries of a map.yaml."""

    mode: Literal["trinary", "scale", "raw"] = "trinary"
    free_thresh: Annotated[float, Field(ge=0, lt=1)] = 0.25

    @field_validator("mode", mode="before")
    @classmethod
    def _lower(cls, mode: object) -> object:
        return mode.lower() if isinstance(mode, str) else mode

    @model_validator(mode="after")
    def _check_order(self) -> _MapFile:
        if self.free_thresh >= self.occupied_thresh:
            raise ValueError(
                f"free_thresh ({self.free_thresh:g}) must be lower than occupied_thresh ({self.occupied_thresh:g})"
            )
        return self


def load_nav2_map(path: Path) -> Nav2Map:
    """Reads a ``map.yaml`` and the picture that it names, relative to the file.

    Raises:
        ConfigError: the file or its picture can't be read or has mistakes; each is named at its line.
    """
    entry, line = read_plan_file(path, "map of a robot (map.yaml)", _MapFile)
    where = f"{path}, line {line}: image"
    _check_picture(path.parent / Path(entry.image), where)
    _, pixels = read_plan_picture(path, entry.image, line)
    height, width = pixels.shape[:2]
    _check_size(width, height, entry.resolution, where)
    _check_origin(entry.origin[0], entry.origin[1], str(path))
    yaw_rad = entry.origin[2] if len(entry.origin) == 3 else 0.0
    T_map_cells = PlanarTransform(entry.origin[0], entry.origin[1], yaw_rad)
    return Nav2Map(_cells(pixels, entry)[::-1].copy(), entry.resolution, T_map_cells)


def _cells(pixels: NDArray[np.uint8], entry: _MapFile) -> NDArray[np.uint8]:
    """(height, width) kinds of cells, as map_server derives them from a picture; row 0 is the uppermost."""
    colours = pixels if pixels.ndim == 3 else pixels[..., None]
    alpha = colours[..., 3] if colours.shape[2] == 4 else None
    # like map_server, which takes the mean of the channels, and in trinary mode of the opacity, too
    shade = colours[..., : 4 if entry.mode == "trinary" else 3].mean(axis=2, dtype=np.float32)
    if entry.mode == "raw":
        return _kinds(np.rint(shade).astype(np.int16))
    occupied = shade / 255.0 if entry.negate else 1.0 - shade / 255.0
    kinds = np.full(shape=shade.shape, fill_value=UNKNOWN, dtype=np.uint8)
    kinds[occupied < entry.free_thresh] = FREE
    kinds[occupied > entry.occupied_thresh] = OCCUPIED
    if entry.mode == "scale":
        between = (occupied >= entry.free_thresh) & (occupied <= entry.occupied_thresh)
        percent = 100.0 * (occupied - entry.free_thresh) / (entry.occupied_thresh - entry.free_thresh)
        kinds[between] = _kinds(np.rint(percent[between]).astype(np.int16))
        if alpha is not None:
            kinds[alpha != 255] = UNKNOWN
    elif not entry.negate:
        kinds[np.rint(shade) == _UNKNOWN_GREY] = UNKNOWN
    return kinds


def _kinds(percent: NDArray[np.int16]) -> NDArray[np.uint8]:
    """Kinds of cells by their probability of being occupied [%]; below 0 and above 100: unknown."""
    kinds = np.full(percent.shape, UNKNOWN, np.uint8)
    kinds[(percent >= 0) & (percent <= _FREE_PERCENT)] = FREE
    kinds[(percent >= _OCCUPIED_PERCENT) & (percent <= 100)] = OCCUPIED
    return kinds


def _check_picture(path: Path, where: str) -> None:
    """Raises ConfigError if a picture has too many pixels, by its first bytes. Other faults are found when it is read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(path.expanduser()) as picture:
                width, height = picture.size
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise ConfigError(f"{where}: a map has at most {MAX_CELLS:,} cells: {error}") from None
    except (OSError, ValueError, RuntimeError):
        return
    if width * height > MAX_CELLS:
        raise ConfigError(f"{where}: a map has at most {MAX_CELLS:,} cells, this picture is {width} x {height}")


def _check_size(width: int, height: int, resolution_m: float, where: str) -> None:
    if not (_MIN_RESOLUTION_M <= resolution_m <= _MAX_RESOLUTION_M):
        raise ConfigError(
            f"{where}: a cell of a map is {_MIN_RESOLUTION_M:g} to {_MAX_RESOLUTION_M:g} m wide, got {resolution_m!r} m"
        )
    if width < 1 or height < 1 or width * height > MAX_CELLS:
        raise ConfigError(f"{where}: a map has 1 to {MAX_CELLS:,} cells, got {width} x {height}")


def _check_origin(x_m: float, y_m: float, where: str) -> None:
    if not max(abs(x_m), abs(y_m)) <= _MAX_ORIGIN_M:
        raise ConfigError(
            f"{where}: its origin lies more than {_MAX_ORIGIN_M / 1000:g} km away, at ({x_m:g}, {y_m:g}) m"
        )
