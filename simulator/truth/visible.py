"""What can be seen of every instance of a simulated view, in measures that don't depend on its resolution."""

from __future__ import annotations

import math
from collections.abc import Container, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from surveilnav.geometry import Matrix4, Pinhole
from surveilnav.perception.vocabulary import COCO
from surveilnav.sensing.views import TrueInstances
from surveilnav.simulator.truth.error_model import Floats, features
from surveilnav.simulator.world.labels import KINDS, PARTS
from surveilnav.words import canonical

#: Instances of these classes are surfaces of the building: what is seen on them belongs to a place, not to a thing.
SURFACES = frozenset({"wall", "floor", "ceiling"})
#: Side of the cells [m] that places are told apart by.
PLACE_M = 0.75
_SURFACE_M = 1.2  # what has no name and looks larger than a square of this side is a surface, too
_SAMPLES = 32  # places are looked for at so many pixels of a row
_NEARER = 0.03  # what is nearer by this share of the range hides what is behind it
_FAR_M = {True: 12.0, False: 6.5}  # where things without depth are thought to be
#: Pose of a level camera at the origin: stands in where nobody tells the pose.
_LEVEL = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 0, 1]], np.float64)

Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class VisibleThing:
    """What can be seen of one instance.

    Attributes:
        id: of the instance.
        label: canonical class.
        box_px: (x0, y0, x1, y1) of its pixels.
        ids: instance ids in the box.
        area_px: its pixels.
        n_pixels: those with depth.
        range_m: their median depth, by a sample of them; NaN if none has any.
        hidden: share of its outline, 0-1, behind which it goes on: something nearer or the picture's edge ends it.
        cut: sides of its box, 0-4, that lie on the picture's edge.
    """

    id: int
    label: str
    box_px: Box
    ids: NDArray[np.uint16]
    area_px: int
    n_pixels: int
    range_m: float
    hidden: float = 0.0
    cut: int = 0

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Its pixels inside the box."""
        return np.asarray(self.ids == self.id)

    @property
    def number(self) -> int:
        """Names it among things and places."""
        return self.id


def visible_things(
    truth: TrueInstances, depth_m: NDArray[np.float32], min_pixels: int, words: Container[str]
) -> list[VisibleThing]:
    """The instances called by one of the words that show at least ``min_pixels`` pixels with depth, by id.

    In a view of a camera without depth all pixels count.
    """
    things, _ = things_and_surfaces(truth, depth_m)
    has_depth = bool(depth_m.any())
    return [
        thing
        for thing in things
        if thing.label in words and (thing.n_pixels if has_depth else thing.area_px) >= min_pixels
    ]


def measured(labels: dict[int, str]) -> dict[int, str]:
    """The labels that the error model has figures for: COCO's classes, kinds of furniture, parts of the building. What is
    called else is to it a thing without a name."""
    known = {label for label in set(labels.values()) if (w := canonical(label)) in COCO or w in KINDS or w in PARTS}
    return {id_: label for id_, label in labels.items() if label in known}


def things_and_surfaces(
    truth: TrueInstances, depth_m: NDArray[np.float32], min_area_px: float = 1.0, f_px: float = 1.0
) -> tuple[list[VisibleThing], set[int]]:
    """The instances that show ``min_area_px`` pixels, with depth or without, by id, and the ids of surfaces: things
    without a name that look larger than ``_SURFACE_M`` at a focal length of ``f_px`` are thought to be some."""
    things, surfaces = [], {i for i, label in truth.labels.items() if canonical(label) in SURFACES}
    area_px = np.bincount(truth.ids.ravel())
    with_depth = np.bincount(truth.ids[depth_m > 0], minlength=len(area_px))
    edges, ends = _outlines(truth.ids, depth_m, len(area_px))
    height, width = depth_m.shape
    for id_, place in enumerate(ndimage.find_objects(truth.ids), start=1):
        if place is None or id_ in surfaces or area_px[id_] < min_area_px:
            continue
        label, (rows, cols) = canonical(truth.labels.get(id_, "")), place
        ids = truth.ids[place]
        range_m = _range_m(ids, id_, depth_m[place]) if with_depth[id_] else math.nan
        if not label and math.sqrt(area_px[id_]) / f_px * range_m > _SURFACE_M:
            surfaces.add(id_)
            continue
        box = (float(cols.start), float(rows.start), float(cols.stop), float(rows.stop))
        cut = (cols.start <= 0) + (rows.start <= 0) + (cols.stop >= width) + (rows.stop >= height)
        hidden = float(ends[id_] / max(1, edges[id_]))
        area, n = int(area_px[id_]), int(with_depth[id_])
        things.append(VisibleThing(id_, label, box, ids, area, n, range_m, hidden, cut))
    return things, surfaces


def _range_m(ids: NDArray[np.uint16], id_: int, depth_m: NDArray[np.float32]) -> float:
    """The median depth [m] of an instance's pixels that have any, by a sample of them if they are many."""
    step = 1 + round(math.sqrt(ids.size) / 40)
    for every in (step, 1):
        depths = depth_m[::every, ::every][ids[::every, ::every] == id_]
        depths = np.sort(depths[depths > 0])
        if len(depths):
            return float(depths[len(depths) // 2])
    return math.nan


def _outlines(
    ids: NDArray[np.uint16], depth_m: NDArray[np.float32], n: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pixels of every instance's outline, and of those the ones beyond which it goes on unseen; both by id
    (0 to n - 1)."""
    edges, ends = np.zeros(n, np.int64), np.zeros(n, np.int64)
    near = np.where(depth_m > 0, depth_m, np.float32(np.inf))
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])):
        where = np.flatnonzero(ids[a] != ids[b])
        id_a, id_b = ids[a].ravel()[where], ids[b].ravel()[where]
        z_a, z_b = near[a].ravel()[where], near[b].ravel()[where]
        edges += np.bincount(id_a, minlength=n) + np.bincount(id_b, minlength=n)
        ends += np.bincount(id_a[z_b < (1 - _NEARER) * z_a], minlength=n)
        ends += np.bincount(id_b[z_a < (1 - _NEARER) * z_b], minlength=n)
    for border in (ids[0], ids[-1], ids[:, 0], ids[:, -1]):
        count = np.bincount(border, minlength=n)
        edges += count
        ends += count
    return edges, ends


@dataclass(frozen=True, slots=True)
class Place:
    """A cell of the world whose surface, a wall's or the floor's, a view shows. ``center_px``: (x, y) in the view."""

    cell: tuple[int, int, int]
    center_px: tuple[float, float]
    range_m: float

    @property
    def number(self) -> int:
        """Names it among things and places."""
        x, y, z = (c & 0xFFFFF for c in self.cell)
        return 1 << 63 | x << 40 | y << 20 | z


def places(
    ids: NDArray[np.uint16], surfaces: set[int], depth_m: NDArray[np.float32], camera: Pinhole, T_world_camera: Matrix4
) -> list[Place]:
    """The places that a view shows; ``surfaces``: the instances that are."""
    height, width = depth_m.shape
    xs = ((np.arange(_SAMPLES) + 0.5) * width / _SAMPLES).astype(int)
    n_rows = round(_SAMPLES * height / width)
    ys = ((np.arange(n_rows) + 0.5) * height / n_rows).astype(int)
    z = depth_m[np.ix_(ys, xs)].ravel().astype(np.float64)
    keep = np.flatnonzero((z > 0) & np.isin(ids[np.ix_(ys, xs)].ravel(), [0, *sorted(surfaces)]))
    if not len(keep):
        return []
    v, u = np.meshgrid(ys + 0.5, xs + 0.5, indexing="ij")
    u, v, z = u.ravel()[keep], v.ravel()[keep], z[keep]
    p = world_points(u, v, z, camera, T_world_camera)
    cells, owner = np.unique(np.floor(p / PLACE_M).astype(np.int64), axis=0, return_inverse=True)
    owner, n = owner.ravel(), np.bincount(owner.ravel())
    mean = [np.bincount(owner, weights=values) / n for values in (u, v, z)]
    return [
        Place((int(c[0]), int(c[1]), int(c[2])), (float(x), float(y)), float(r))
        for c, x, y, r in zip(cells, *mean, strict=True)
    ]


def world_points(u_px: Floats, v_px: Floats, z_m: Floats, camera: Pinhole, T_world_camera: Matrix4) -> Floats:
    """(N, 3) in the world of pixels at a depth along the optical axis."""
    T = T_world_camera
    p = np.stack([(u_px - camera.cx_px) / camera.fx_px * z_m, (v_px - camera.cy_px) / camera.fy_px * z_m, z_m], axis=-1)
    return np.asarray(p @ T[:3, :3].T + T[:3, 3], np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class Candidates:
    """All of one kind that a view shows: what the detector may find, in the measures of the error model.

    ``kind``: "thing" (of a class that detectors know), "other" (of none) or "place". ``x``: (N, F) its features.
    ``direction``: (N, 3) unit vectors to the camera in the world. ``shown``: the things or places themselves.
    """

    kind: str
    labels: list[str]
    ids: NDArray[np.uint64]
    x: Floats
    direction: Floats
    range_m: Floats
    shown: Sequence[VisibleThing | Place]


def candidates(
    truth: TrueInstances, depth_m: NDArray[np.float32], camera: Pinhole, is_camera: bool, min_size_rad: float
) -> list[Candidates]:
    """What a view shows, by kind. ``is_camera``: a surveillance camera's view; things that look smaller are left out."""
    min_area_px = min_size_rad**2 * camera.fx_px * camera.fy_px
    things, surfaces = things_and_surfaces(truth, depth_m, min_area_px, camera.fx_px)
    T = _LEVEL if truth.T_world_camera is None else truth.T_world_camera
    seen: dict[str, Sequence[VisibleThing | Place]] = {
        "thing": [t for t in things if t.label in COCO],
        "other": [t for t in things if t.label not in COCO],
        "place": places(truth.ids, surfaces, depth_m, camera, T),
    }
    return [_measured(kind, shown, camera, T, is_camera) for kind, shown in seen.items() if shown]


def _measured(
    kind: str, shown: Sequence[VisibleThing | Place], camera: Pinhole, T: Matrix4, is_camera: bool
) -> Candidates:
    far_m = _FAR_M[is_camera]
    rows = [
        (*t.center_px, t.range_m, PLACE_M / t.range_m, 0.0, 0)
        if isinstance(t, Place)
        else (
            (t.box_px[0] + t.box_px[2]) / 2,
            (t.box_px[1] + t.box_px[3]) / 2,
            far_m if math.isnan(t.range_m) else t.range_m,
            math.sqrt(t.area_px) / camera.fx_px,
            t.hidden,
            t.cut,
        )
        for t in shown
    ]
    u, v, z, size, hidden, cut = np.array(rows, np.float64).T
    away = world_points(u, v, z, camera, T) - T[:3, 3]
    range_m = np.linalg.norm(away, axis=1)
    elevation = np.arcsin(np.clip(-away[:, 2] / range_m, -1, 1))
    x = features(size, range_m, hidden, cut, elevation, is_camera)
    ids = np.array([t.number for t in shown], np.uint64)
    labels = ["" if isinstance(t, Place) else t.label for t in shown]
    return Candidates(kind, labels, ids, x, -away / range_m[:, None], range_m, shown)
