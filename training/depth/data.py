"""Batches for training: views drawn and varied anew at every step, the same for the same seed and step.

Varied: mirror, crop, scale of the building, errors of the calibration, light, colour, blur, noise, JPEG.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import cv2
import msgspec
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from surveilnav.geometry import Pinhole
from surveilnav.perception.depth.reference import reference_channels, reference_depth
from training.depth.floor import floor_mask
from training.depth.network import OUTPUT_STRIDE
from training.depth.pack import DepthView, Pack, ViewGeometry

#: (width, height) of batches, multiples of 32. Small ones cost half; training begins with them.
CANVASES = ((256, 256), (256, 192), (256, 160))
SMALL_CANVASES = ((192, 192), (192, 160), (192, 128))
#: A crop's width over the stored picture's; how much its sides are stretched against each other at most.
_CROP, _STRETCH = (0.7, 1.0), 0.05
#: So often a building is another size. Cameras up to 3 m high come only from that, since most ceilings are at 2.5 m.
_SCALED, _SCALE = 0.3, (0.9, 1.3)
#: So often the calibration is imprecise; standard deviations of height and focal length (shares), pitch and roll.
_IMPRECISE, _HEIGHT_ERROR, _FOCAL_ERROR = 0.7, 0.02, 0.015
_PITCH_ERROR_RAD, _ROLL_ERROR_RAD = math.radians(0.7), math.radians(0.5)
#: Chances of each way of varying the picture. Grey: cameras at night.
_LIT, _BLUR, _NOISE, _JPEG, _GREY = 0.6, 0.25, 0.4, 0.4, 0.06
_AHEAD = 3


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """B views of H x W pixels, h x w = H / 2 x W / 2 cells.

    Attributes:
        pictures: (B, 3, H, W) uint8.
        geometry: (B, 5, h, w) as ``reference_channels`` has it.
        log_ratio: (B, h, w) log of depth over reference depth, 0 on the floor.
        floor, known: (B, h, w) bool, whether the cell shows the floor; whether it has a depth.
    """

    pictures: Tensor
    geometry: Tensor
    log_ratio: Tensor
    floor: Tensor
    known: Tensor


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """One varied view: as ``Batch``, channels last."""

    rgb: NDArray[np.uint8]
    geometry: NDArray[np.float32]
    log_ratio: NDArray[np.float32]
    floor: NDArray[np.bool_]
    known: NDArray[np.bool_]


class Views:
    """All views of some packs, drawn by seed, step and process. The first ``small_steps`` steps have small canvases."""

    def __init__(self, packs: Sequence[Pack], seed: int = 0, small_steps: int = 0, process: int = 0) -> None:
        self._packs, self._seed, self._small_steps, self._process = packs, seed, small_steps, process
        self._rows = [(p, i) for p, pack in enumerate(packs) for i in range(len(pack.views))]

    def __len__(self) -> int:
        return len(self._rows)

    def batch(self, step: int, size: int) -> Batch:
        rng = np.random.default_rng([self._seed, step, self._process])
        canvases = SMALL_CANVASES if step < self._small_steps else CANVASES
        canvas = canvases[rng.integers(len(canvases))]
        chosen = [self._rows[i] for i in rng.integers(len(self._rows), size=size)]
        return collate([varied(self._packs[p].view(i), canvas, rng) for p, i in chosen])

    def batches(self, first: int, last: int, size: int) -> Iterator[Batch]:
        """The batches of steps ``first`` to ``last`` - 1, made ahead by a thread."""
        with ThreadPoolExecutor(1) as pool:
            waiting: deque[Future[Batch]] = deque()
            for step in range(first, last):
                while len(waiting) < _AHEAD and step + len(waiting) < last:
                    waiting.append(pool.submit(self.batch, step + len(waiting), size))
                yield waiting.popleft().result()


def collate(examples: Sequence[Example]) -> Batch:
    def stacked(arrays: Sequence[NDArray[np.generic]]) -> Tensor:
        return torch.from_numpy(np.stack(arrays))

    return Batch(
        stacked([e.rgb for e in examples]).permute(0, 3, 1, 2),
        stacked([e.geometry for e in examples]).permute(0, 3, 1, 2),
        stacked([e.log_ratio for e in examples]),
        stacked([e.floor for e in examples]),
        stacked([e.known for e in examples]),
    )


def varied(view: DepthView, canvas: tuple[int, int], rng: np.random.Generator) -> Example:
    """A view cropped to ``canvas`` (width, height) [pixels], and varied."""
    rgb, depth_m, geometry = view.rgb, view.depth_m.astype(np.float32), view.geometry
    if rng.random() < 0.5:
        rgb, depth_m = rgb[:, ::-1], depth_m[:, ::-1]
        geometry = msgspec.structs.replace(geometry, roll_rad=-geometry.roll_rad)
    if rng.random() < _SCALED:
        scale = rng.uniform(*_SCALE)
        depth_m = depth_m * np.float32(scale)
        geometry = msgspec.structs.replace(geometry, height_m=geometry.height_m * scale)
    camera = geometry.camera(len(depth_m))
    true = reference_depth(camera, geometry.pose(), 0.0)
    floor = floor_mask(depth_m, true.depth_m, true.floor, true.height_m)
    # Crop and size.
    (width, height), side = canvas, len(depth_m)
    crop = Crop.drawn(side, canvas, rng)
    picture = crop.picture(np.ascontiguousarray(rgb), canvas)
    grid = width // OUTPUT_STRIDE, height // OUTPUT_STRIDE
    at = crop.nearest(grid)
    # The network is shown the geometry as it was calibrated. Where it isn't the floor, true depth is what it should find.
    lens, shown = _imprecise(crop.camera(camera, grid), geometry, rng)
    reference = reference_depth(lens, shown.pose(), 0.0)
    sampled, on_floor = depth_m[at], floor[at]
    known = sampled > 0.0
    log_ratio = np.log(np.where(known & ~on_floor, sampled, reference.depth_m) / reference.depth_m)
    return Example(
        photographed(picture, rng),
        reference_channels(reference, lens),
        log_ratio.astype(np.float32),
        on_floor,
        known,
    )


@dataclass(frozen=True, slots=True)
class Crop:
    """A rectangle of a picture [pixels]; edges may lie between pixels."""

    x: float
    y: float
    width: float
    height: float

    @classmethod
    def drawn(cls, side: int, canvas: tuple[int, int], rng: np.random.Generator) -> Crop:
        """Of a square picture, of about the canvas's shape."""
        width = side * rng.uniform(*_CROP) if rng.random() < 0.6 else float(side)
        height = min(float(side), width * canvas[1] / canvas[0] * (1.0 + rng.uniform(-_STRETCH, _STRETCH)))
        return cls(rng.uniform(0.0, side - width), rng.uniform(0.0, side - height), width, height)

    def camera(self, camera: Pinhole, size: tuple[int, int]) -> Pinhole:
        """Intrinsics of the cropped picture at ``size`` (width, height)."""
        sx, sy = size[0] / self.width, size[1] / self.height
        cx, cy = (camera.cx_px + 0.5 - self.x) * sx - 0.5, (camera.cy_px + 0.5 - self.y) * sy - 0.5
        return Pinhole(*size, camera.fx_px * sx, camera.fy_px * sy, cx, cy)

    def picture(self, rgb: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
        sx, sy = size[0] / self.width, size[1] / self.height
        A = np.array([[sx, 0.0, (0.5 - self.x) * sx - 0.5], [0.0, sy, (0.5 - self.y) * sy - 0.5]])
        if min(sx, sy) < 0.9:  # warping doesn't average
            rgb = cv2.GaussianBlur(rgb, (3, 3), 0.35 / min(sx, sy)).astype(np.uint8)
        warped = cv2.warpAffine(rgb, A, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(warped, np.uint8)

    def nearest(self, size: tuple[int, int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Index of the pixel nearest to each cell's centre of a grid (columns, rows)."""
        u = self.x + (np.arange(size[0]) + 0.5) * self.width / size[0]
        v = self.y + (np.arange(size[1]) + 0.5) * self.height / size[1]
        return v.astype(np.intp)[:, None], u.astype(np.intp)[None, :]


def _imprecise(lens: Pinhole, geometry: ViewGeometry, rng: np.random.Generator) -> tuple[Pinhole, ViewGeometry]:
    if rng.random() >= _IMPRECISE:
        return lens, geometry
    f = 1.0 + _FOCAL_ERROR * rng.normal()
    lens = Pinhole(lens.width_px, lens.height_px, lens.fx_px * f, lens.fy_px * f, lens.cx_px, lens.cy_px)
    shown = msgspec.structs.replace(
        geometry,
        height_m=geometry.height_m * (1.0 + _HEIGHT_ERROR * rng.normal()),
        pitch_rad=geometry.pitch_rad + _PITCH_ERROR_RAD * rng.normal(),
        roll_rad=geometry.roll_rad + _ROLL_ERROR_RAD * rng.normal(),
    )
    return lens, shown


def photographed(rgb: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """The picture in other light and colours, with a sensor's and a codec's faults."""
    height, width = rgb.shape[:2]
    x = rgb.astype(np.float32)
    if rng.random() < _LIT:  # lamps and shade, in place of the flat light of the renderer
        light = np.exp(rng.normal(0.0, 0.35, (4, 4))).astype(np.float32)
        x *= cv2.resize(light, (width, height), interpolation=cv2.INTER_CUBIC).clip(0.3, 2.5)[..., None]
    x *= np.exp(rng.normal(0.0, 0.06, 3)).astype(np.float32) * np.float32(np.exp(rng.normal(0.0, 0.2)))
    grey = x.mean(axis=2, keepdims=True)
    colour = 0.0 if rng.random() < _GREY else rng.uniform(0.4, 1.3)
    x = grey + (x - grey) * np.float32(colour)
    x = 255.0 * (x / 255.0).clip(0.0, 1.0) ** np.float32(np.exp(rng.normal(0.0, 0.2)))
    if rng.random() < _BLUR:
        x = cv2.GaussianBlur(x, (5, 5), rng.uniform(0.4, 1.2))
    if rng.random() < _NOISE:
        x += rng.normal(0.0, rng.uniform(2.0, 12.0), (height, width, 3 if rng.random() < 0.5 else 1))
    out = x.clip(0, 255).astype(np.uint8)
    if rng.random() < _JPEG:
        done, data = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(25, 85))])
        assert done
        decoded = cv2.imdecode(data, cv2.IMREAD_COLOR)
        assert decoded is not None
        out = decoded.astype(np.uint8)
    return np.ascontiguousarray(out)
