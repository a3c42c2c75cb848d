"""A robot's frame from places that are known both in the building and in the robot's map, such as corners of rooms.

Least squares in closed form (Umeyama 1991, "Least-squares estimation of transformation parameters between two point patterns",
without scale: both frames are in metres).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from surveilnav.errors import FrameError
from surveilnav.robot_frame.found_frame import FoundFrame, in_words, listed
from surveilnav.robot_frame.planar import PlanarTransform

_Array = NDArray[np.float64]
#: Places nearer to each other than this are one place: their line would have any direction.
_MIN_SPREAD_M = 0.3
#: From this distance on, a pair that contradicts the others is wrong rather than inaccurate; also if it is so many times as far
#: off as the others are on average.
_GROSS_M, _TIMES_OTHERS = 0.3, 4.0
#: How exactly a person measures a place, for what is said about a frame that rests on few pairs.
_CLICK_M = 0.05
_MAX_PAIRS = 1000


def from_point_pairs(p_building: ArrayLike, p_map: ArrayLike) -> FoundFrame:
    """``T_building_map`` by least squares. Of four pairs or more, one may be wrong: it is left out, and named.

    Args:
        p_building: (n, 2) places in the building [m].
        p_map: (n, 2) the same places in the robot's map [m].

    Raises:
        FrameError: the pairs don't determine a frame, or contradict each other; the text says which to add or to correct.
    """
    b, m = _checked(p_building, p_map)
    kept = np.arange(len(b))
    left_out: tuple[int, ...] = ()
    if len(b) >= 4 and (wrong := _gross_error(b, m)) is not None:
        kept, left_out = np.delete(kept, wrong), (wrong + 1,)
    T, residual_m = _fit(b[kept], m[kept])
    if residual_m > (_GROSS_M if len(b) > 2 else _GROSS_M / 2):  # of two places, each is off by half the difference
        raise _contradiction(b, m, residual_m)
    return FoundFrame(
        T, residual_m, None, "point pairs", len(kept), _sentence(T, residual_m, b[kept], left_out), left_out
    )


def _checked(p_building: ArrayLike, p_map: ArrayLike) -> tuple[_Array, _Array]:
    b, m = np.asarray(p_building, np.float64), np.asarray(p_map, np.float64)
    if b.shape != m.shape or b.ndim != 2 or b.shape[1] != 2 or not (np.isfinite(b).all() and np.isfinite(m).all()):
        raise FrameError(
            "undetermined",
            f"expected as many finite places (x, y) in the building as in the map, got {b.shape} and {m.shape}",
        )
    if not 2 <= len(b) <= _MAX_PAIRS:
        raise FrameError(
            "undetermined",
            f"a frame needs 2 pairs of places, and is good from 3 on (at most {_MAX_PAIRS}); got {len(b)}",
        )
    for places, where in ((b, "building"), (m, "map")):
        spread_m = _spread_m(places)
        if spread_m < _MIN_SPREAD_M:
            raise FrameError(
                "undetermined",
                f"all places lie within {spread_m:.2f} m in the {where}, so the map could be turned in any way: add a pair "
                "several metres away",
            )
    return b, m


def _spread_m(p: _Array) -> float:
    """The distance of the two places that are farthest apart."""
    return float(max(np.linalg.norm(p - q, axis=1).max() for q in p))


def _fit(b: _Array, m: _Array, mirrored: bool = False) -> tuple[PlanarTransform, float]:
    """The transform of least squares, and the root mean square distance [m]. ``mirrored``: the map's y axis is turned round."""
    if mirrored:
        m = m * (1.0, -1.0)
    b0, m0 = b.mean(axis=0), m.mean(axis=0)
    db, dm = b - b0, m - m0
    # in the plane, Umeyama's singular value decomposition comes down to one angle
    yaw_rad = math.atan2(float((dm[:, 0] * db[:, 1] - dm[:, 1] * db[:, 0]).sum()), float((dm * db).sum()))
    turn = PlanarTransform(0.0, 0.0, yaw_rad)
    x, y = b0 - turn.apply(m0)
    T = PlanarTransform(float(x), float(y), yaw_rad)
    return T, float(np.sqrt(np.square(b - T.apply(m)).sum(axis=1).mean()))


def _gross_error(b: _Array, m: _Array) -> int | None:
    """The one pair that contradicts all others, which agree; None: there is none, or more than one."""
    found = []
    for k in range(len(b)):
        others = np.delete(np.arange(len(b)), k)
        if min(_spread_m(b[others]), _spread_m(m[others])) < _MIN_SPREAD_M:
            continue
        T, residual_m = _fit(b[others], m[others])
        off_m = float(np.hypot(*(b[k] - T.apply(m[k]))))
        if off_m > max(_GROSS_M, _TIMES_OTHERS * residual_m) and residual_m <= _GROSS_M:
            found.append((residual_m, k))
    if not found:
        return None
    found.sort()
    if len(found) > 1 and found[1][0] < 2 * max(found[0][0], 0.5 * _CLICK_M):
        pairs = tuple(sorted(k + 1 for _, k in found[:2]))
        raise FrameError(
            "contradictory",
            f"either pair {pairs[0]} or pair {pairs[1]} is wrong: the others agree with each of the two, but not with both. "
            "Check them, or add a pair elsewhere",
            pairs,
        )
    return found[0][1]


def _contradiction(b: _Array, m: _Array, residual_m: float) -> FrameError:
    if len(b) == 2:
        in_building, in_map = (float(np.hypot(*(p[1] - p[0]))) for p in (b, m))
        return FrameError(
            "contradictory",
            f"the two places are {in_building:.2f} m apart in the building and {in_map:.2f} m in the map: one of them is wrong, "
            "or the scale of the plan is",
            (1, 2),
        )
    if _fit(b, m, mirrored=True)[1] < residual_m / _TIMES_OTHERS:
        return FrameError(
            "mirrored",
            "the pairs would fit if one frame were seen in a mirror: x and y are exchanged, or a picture's rows were counted "
            "from the top. In both frames, y points to the left of x",
        )
    off_m = _off_m(b, m)
    worst = int(np.argmax(off_m)) + 1
    more = "add a fourth pair: then the wrong one can be told" if len(b) == 3 else "check all pairs"
    return FrameError(
        "contradictory",
        f"the pairs contradict each other by {residual_m:.2f} m on average, pair {worst} most ({off_m[worst - 1]:.2f} m): {more}",
        (worst,) if len(b) > 3 else (),
    )


def _off_m(b: _Array, m: _Array) -> _Array:
    T, _ = _fit(b, m)
    return np.asarray(np.linalg.norm(b - T.apply(m), axis=1))


def _sentence(T: PlanarTransform, residual_m: float, b: _Array, left_out: tuple[int, ...]) -> str:
    n, spread_m = len(b), _spread_m(b)
    text = f"By {n} pairs of places, {in_words(T)}"
    if n == 2:
        text += (
            f". With two pairs, only their distance could be checked: it differs by {2 * residual_m:.2f} m. Add a third pair, so "
            "that a wrong one shows"
        )
    else:
        text += f"; the places differ by {residual_m:.2f} m on average"
    turn_deg = math.degrees(math.atan2(max(residual_m, _CLICK_M), spread_m))
    if turn_deg > 1.0:
        text += (
            f". They lie only {spread_m:.1f} m apart, so the turn is uncertain by about {turn_deg:.1f} degrees: add a pair "
            "farther away"
        )
    if left_out:
        text += f". Pair {listed(left_out)} contradicts the others and wasn't used"
    return text
