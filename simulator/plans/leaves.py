"""The leaf of a door: whatever of its model fills the opening, by whatever name.

Sweet Home 3D's own doors name the parts that move (``openings.is_moving_part``); other libraries and older versions don't.
So an open door loses what stands in a robot's way: a leaf or two, their panes and handles, a sliding panel. The frame
around it stays.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from surveilnav.simulator.plans.sweethome import Piece
from surveilnav.simulator.world.assembly import Mesh

#: Frames keep to this share of the width on both sides, and at least so much [m]; posts of frames are slimmer.
_SIDE_SHARE, _SIDE_M = 0.2, 0.1
#: What fills an opening does so between these heights above the door's foot [m]: higher than a sill, lower than a transom.
_LOW_M, _HIGH_M = 0.25, 1.6
_LINTEL_M = 0.2
#: A part that takes this share of the width or more holds the frame, too.
_WHOLE_SHARE = 0.95
#: Parts of a leaf keep within its outline, this much aside [m]; a jamb's face lies on the edge.
_SLACK_M, _EDGE_M = 0.01, 0.03
#: Corners that lie this close are one [m].
_WELD_M = 1e-4


def without_leaf(mesh: Mesh, piece: Piece, z_floor_m: float) -> Mesh:
    """A door without what fills its opening.

    Args:
        mesh: of the door, placed in the world.
        z_floor_m: its level's floor.
    """
    corners = _in_front_of(mesh, piece, z_floor_m)
    fills = _fills_opening(corners, piece)
    if not fills.any():
        return mesh
    keep = ~_belongs_to_leaf(corners, fills, _parts_of(mesh), _WHOLE_SHARE * piece.size_m[0])
    return mesh.part(keep)


def _in_front_of(mesh: Mesh, piece: Piece, z_floor_m: float) -> NDArray[np.float64]:
    """Corners (F, 3, 3) in the door's own frame: along its width from the middle, across, above its foot [m]."""
    p = mesh.vertices[mesh.triangles].astype(np.float64) - (piece.x_m, piece.y_m, z_floor_m + piece.z_m)
    c, s = math.cos(piece.yaw_rad), math.sin(piece.yaw_rad)
    return np.stack([c * p[..., 0] + s * p[..., 1], -s * p[..., 0] + c * p[..., 1], p[..., 2]], axis=-1)


def _fills_opening(corners: NDArray[np.float64], piece: Piece) -> NDArray[np.bool_]:
    """(F,) which triangles reach into the middle of the opening, seen from the front."""
    width, _, height = piece.size_m
    half = width / 2 - max(_SIDE_SHARE * width, _SIDE_M)
    low, high = _LOW_M, min(_HIGH_M, height - _LINTEL_M)
    if half <= 0 or high <= low:
        return np.zeros(len(corners), dtype=np.bool_)
    return _overlap(corners[..., [0, 2]], (-half, low), (half, high))


def _overlap(t: NDArray[np.float64], low: tuple[float, float], high: tuple[float, float]) -> NDArray[np.bool_]:
    """(F,) which triangles (F, 3, 2) overlap a rectangle: no axis separates them (Gottschalk, Lin and Manocha 1996)."""
    apart = np.any((t.max(axis=1) <= low) | (t.min(axis=1) >= high), axis=1)
    box = np.array([(x, y) for x in (low[0], high[0]) for y in (low[1], high[1])])
    for a, b in ((0, 1), (1, 2), (2, 0)):
        side = t[:, b] - t[:, a]
        normal = np.column_stack([-side[:, 1], side[:, 0]])
        ours = np.einsum("fc,fkc->fk", normal, t)
        theirs = normal @ box.T
        apart |= (ours.max(axis=1) <= theirs.min(axis=1)) | (ours.min(axis=1) >= theirs.max(axis=1))
    return np.asarray(~apart)


def _parts_of(mesh: Mesh) -> NDArray[np.int32]:
    """(F,) numbers of the connected parts that the triangles belong to."""
    _, at = np.unique(np.round(mesh.vertices / _WELD_M).astype(np.int64), axis=0, return_inverse=True)
    t = at.reshape(-1)[mesh.triangles]
    links = np.concatenate([t[:, [0, 1]], t[:, [1, 2]]])
    n = int(at.max()) + 1
    _, label = connected_components(coo_array((np.ones(len(links)), links.T), shape=(n, n)), directed=False)
    return np.asarray(label[t[:, 0]])


def _belongs_to_leaf(
    corners: NDArray[np.float64], fills: NDArray[np.bool_], part: NDArray[np.int32], frame_m: float
) -> NDArray[np.bool_]:
    """(F,) which triangles are leaf.

    A part that fills the opening is leaf as a whole. But where it is as wide as the frame, ``frame_m`` or more, and
    reaches beyond the triangles that fill the opening, leaf and frame are one piece: then only what lies within those.
    A smaller part in front of a leaf (a handle, a pane) or below it (a rail) is leaf too.
    """
    leaf = np.zeros(len(corners), dtype=np.bool_)
    low3, high3 = corners.min(axis=1), corners.max(axis=1)
    filling = np.unique(part[fills])
    boxes = []
    for number in filling:
        own = part == number
        low, high = low3[own & fills].min(axis=0), high3[own & fills].max(axis=0)
        within = np.all((low3 >= low - _SLACK_M) & (high3 <= high + _SLACK_M), axis=1)
        beyond = low3[own][:, 0].min() < low[0] - _EDGE_M or high3[own][:, 0].max() > high[0] + _EDGE_M
        whole = not beyond or np.ptp(corners[own][..., 0]) < frame_m
        leaf |= own if whole else own & within
        boxes.append((low3[own].min(axis=0), high3[own].max(axis=0)) if whole else (low, high))
    low, high = np.min([b[0] for b in boxes], axis=0), np.max([b[1] for b in boxes], axis=0)
    low[2] = 0.0
    for number in np.setdiff1d(part, filling):
        own = part == number
        a, b = low3[own].min(axis=0)[[0, 2]], high3[own].max(axis=0)[[0, 2]]
        flat_low, flat_high = low[[0, 2]], high[[0, 2]]
        inside = np.all(a >= flat_low - _SLACK_M) and np.all(b <= flat_high + _SLACK_M)
        middle = (a + b) / 2
        if inside and np.all(middle > flat_low + _EDGE_M) and np.all(middle < flat_high - _EDGE_M):
            leaf |= own
    return leaf
