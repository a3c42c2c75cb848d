"""The floors of a building that only a mesh is known of: DBSCAN on walkable heights (the paper's section III)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from sklearn.cluster import DBSCAN

from surveilnav.simulator.meshes.walkable import Spots
from surveilnav.simulator.world.scene import Floor, Room

#: Heights nearer than this belong together; floors of scans are uneven by some centimetres.
_EPS_M = 0.1
#: A height has at least this much walkable area, and this share of all, within ``_EPS_M``, or it is a tread or a ramp.
_DENSE_M2, _DENSE_SHARE = 1.0, 0.03
#: Ground rises less than this over twice ``_BASE_M``; garden slopes and roofs rise more.
_RISE_M, _BASE_M = 0.05, 0.2
#: A floor has at least this much room for a robot's centre.
MIN_FLOOR_M2 = 4.0
#: What is nearer than this to a larger floor is furniture, unless steps lead there, ...
_NEAR_M = 1.5
#: ... and nearer than this it is a step in the floor that our robots don't take.
_SPLIT_M = 0.6
_ROOFED = 0.1
_DEFAULT_HEIGHT_M = 2.5
_MAX_HEIGHT_M = 6.0


@dataclass(frozen=True, slots=True, eq=False)
class FloorGround:
    """A floor and its spots: ``on`` (N,) bool of all spots."""

    floor: Floor
    area_m2: float
    on: NDArray[np.bool_]


def find_floors(spots: Spots) -> tuple[tuple[FloorGround, ...], tuple[str, ...]]:
    """The floors from below to above, called "0", "1", ..., and notes on levels that are none."""
    chosen = spots.wide & _indoors(spots) & _flat(spots)
    clusters = _clusters(spots, chosen)
    kept: list[tuple[float, float, set[int]]] = []  # height, area, parts
    notes: list[str] = []
    for z, area, parts in sorted(clusters, key=lambda c: -c[1]):
        if area < MIN_FLOOR_M2:
            continue
        near = [k for k in kept if abs(k[0] - z) < _NEAR_M]
        if any(abs(k[0] - z) < _SPLIT_M or not parts & k[2] for k in near):
            notes.append(
                f"a level of {area:.0f} m2 at {z:.2f} m isn't a floor: too near to the one at {near[0][0]:.2f} m"
            )
            continue
        kept.append((z, area, parts))
    kept.sort(key=lambda k: k[0])
    grounds = []
    for number, (z, area, _) in enumerate(kept):
        on = np.abs(spots.z_m - z) <= _EPS_M
        clear = spots.clear_m[on & chosen]
        clear = clear[clear < _MAX_HEIGHT_M]
        height = float(np.median(clear)) if len(clear) else _DEFAULT_HEIGHT_M
        if number + 1 < len(kept):
            height = min(height, kept[number + 1][0] - z)
        floor = Floor(str(number), "Ground floor" if number == 0 else f"Floor {number}", z, height)
        grounds.append(FloorGround(floor, area, on))
        spread = np.percentile(spots.z_m[chosen & (np.abs(spots.z_m - z) < 3 * _EPS_M)], (5, 95))
        if spread[1] - spread[0] > 2 * _EPS_M:
            notes.append(
                f"floor {number} isn't level ({spread[0]:.2f} to {spread[1]:.2f} m): its ends can't be driven on"
            )
    return tuple(grounds), tuple(notes)


def _indoors(spots: Spots) -> NDArray[np.bool_]:
    """Spots of parts with a roof over some of it, which leaves out roofs; all if nothing has a roof."""
    if not len(spots.z_m):
        return np.zeros(0, np.bool_)
    size = np.bincount(spots.part, spots.wide)
    roofed = np.bincount(spots.part, spots.wide & np.isfinite(spots.clear_m)) >= _ROOFED * np.maximum(size, 1)
    large = size * spots.cell_m2 >= MIN_FLOOR_M2
    usable = roofed & large
    return np.asarray(usable[spots.part] if usable.any() else np.ones(len(spots.z_m), np.bool_))


def _flat(spots: Spots) -> NDArray[np.bool_]:
    """Spots whose ground rises little in both directions."""
    flat = np.ones(len(spots.z_m), np.bool_)
    for ahead, back in ((0, 1), (2, 3)):
        ends = []
        for side in (ahead, back):
            spot = np.arange(len(spots.z_m))
            for _ in range(max(1, round(_BASE_M / spots.grid.resolution_m))):
                spot = np.where(spots.neighbour[side, spot] >= 0, spots.neighbour[side, spot], spot)
            ends.append(spots.z_m[spot])
        flat &= np.abs(ends[0] - ends[1]) < _RISE_M
    return flat


def _clusters(spots: Spots, chosen: NDArray[np.bool_]) -> list[tuple[float, float, set[int]]]:
    """Height [m], area [m2] and parts of every dense height among the chosen spots."""
    if not chosen.any():
        return []
    z, part = spots.z_m[chosen], spots.part[chosen]
    centimetre, index, count = np.unique(np.round(z / 0.01).astype(int), return_inverse=True, return_counts=True)
    # Equal heights are one point with a weight: DBSCAN's neighbourhoods stay small.
    dense = DBSCAN(eps=_EPS_M, min_samples=max(1, round(_DENSE_M2 / spots.cell_m2), round(_DENSE_SHARE * len(z))))
    labels = dense.fit_predict(centimetre[:, None] * 0.01, sample_weight=count)
    of_spot = labels[index]
    found = []
    for label in range(int(labels.max(initial=-1)) + 1):
        mine = of_spot == label
        found.append(
            (
                round(float(np.median(z[mine])), 3) + 0.0,
                float(mine.sum() * spots.cell_m2),
                set(np.unique(part[mine]).tolist()),
            )
        )
    return found


def outlines(spots: Spots, ground: FloorGround) -> list[Room]:
    """The outlines of a floor's connected ground, as rooms: a mesh doesn't say where rooms end."""
    grid = spots.grid
    cells = np.zeros(grid.rows * grid.cols, np.uint8)
    cells[spots.column[ground.on]] = 1
    closed = cv2.morphologyEx(cells.reshape(grid.shape), cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    contours, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    rooms: list[Room] = []
    for contour in sorted(contours, key=lambda c: -cv2.contourArea(c)):
        simple = cv2.approxPolyDP(contour, 2.0, True)[:, 0]
        if len(simple) < 3 or cv2.contourArea(simple) * spots.cell_m2 < MIN_FLOOR_M2:
            continue
        xy = grid.centres_of(simple[:, ::-1])
        name = ground.floor.name if not rooms else f"{ground.floor.name}, part {len(rooms) + 1}"
        rooms.append(Room(name, ground.floor.id, tuple((float(x), float(y)) for x, y in xy)))
    return rooms
