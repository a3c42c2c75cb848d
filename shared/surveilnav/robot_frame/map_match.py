"""A robot's frame by matching its map with the joint map of the same floor, wherever it lies and however it is turned.

Correlative matching (Olson 2009, "Real-time correlative scan matching"), coarse to fine. What is compared are likelihood fields:
how near a place is to the next obstacle (Thrun et al. 2005, 6.4). Both directions count: obstacles of the robot's map should lie
where the joint map has some, and the other way round. Only places that both maps know are compared, so they may overlap in part:

    gain(T) = sum over the robot's obstacles p with T p known to the joint map of (near_joint(T p) - CHANCE)
            + WEIGHT * sum over the joint map's obstacles q with T^-1 q known to the robot of (near_robot(T^-1 q) - CHANCE)

A place where obstacles coincide adds to it, one where they contradict each other takes away. At first all turns are tried in
coarse cells, for each of them all shifts at once by the convolution theorem (``coarse_match``). Then the best of these are
climbed from, in finer steps.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import FrameError
from surveilnav.geometry import Grid
from surveilnav.robot_frame.coarse_match import coarse_matches
from surveilnav.robot_frame.found_frame import FoundFrame, in_words
from surveilnav.robot_frame.map_side import CHANCE, WEIGHT, MapSide, is_same
from surveilnav.robot_frame.nav2_map import Nav2Map
from surveilnav.robot_frame.planar import PlanarTransform

_Array = NDArray[np.float64]
_Layer = NDArray[np.float32]
#: Distance to the next obstacle [m, standard deviation] at which a place counts 0.6 of one in the same place.
_FINE_SIGMA_M, _FINEST_SIGMA_M = 0.08, 0.04
_CLIMBED_TO_THE_TOP = 6
#: Steps of the climb [m, rad].
_STEPS = tuple((0.1 / 2**k, math.radians(1.0) / 2**k) for k in range(5))
_MAX_POINTS = 3000
#: A result is refused if another place gains more than this share of what it does (where maps overlap by a third: at most .4).
_MAX_NEXT_SHARE = 0.65
#: ... or if less than so much free floor is known to both maps, or so few metres of obstacles of the robot's.
_MIN_FLOOR_M2, _MIN_OBSTACLES_M = 12.0, 8.0
#: ... or if the gain is less than this share of what it would be if all that is compared coincided. On made-up floors of which a
#: fifth of the furniture differs it is 0.68 and more, between different floors at most 0.36.
_MIN_GAIN_SHARE = 0.5
#: An obstacle agrees with one so near.
_AGREES_M = 0.15


def match_maps(
    robot: Nav2Map,
    grid: Grid,
    occupancy: NDArray[np.uint8],
    explored: NDArray[np.uint8],
    near: PlanarTransform | None = None,
    within_m: float = 1.0,
    within_rad: float = math.radians(15.0),
) -> FoundFrame:
    """``T_building_map`` by which a robot's map fits the joint map best.

    Args:
        robot: its map.
        grid: frame of the joint map's layers, ``occupancy`` (0: no obstacle) and ``explored`` (0: not), (rows, cols).
        near: only transforms near this one are tried; None: all.
        within_m, within_rad: how near: what is in the middle of the robot's obstacles lies within this distance, and its turn
            within this angle.

    Raises:
        FrameError: ``ambiguous``, it fits at another place nearly as well; ``too_little_overlap``; ``no_match``.
    """
    joint = MapSide.from_joint(grid, occupancy, explored)
    own = MapSide.from_robot(robot)
    for side, whose in ((own, "the robot's map"), (joint, "the joint map")):
        if len(side.obstacles) * side.cell_m < _MIN_OBSTACLES_M:
            raise FrameError(
                "too_little_overlap", f"{whose} shows hardly any obstacle: let it see more of the floor first"
            )
    pivot = own.obstacles.mean(axis=0)  # the middle of what is matched, about which it is turned
    found = _Climb(own, joint).best(coarse_matches(own, joint, pivot, near, within_m, within_rad))
    if not found or found[0][0] <= 0:
        raise FrameError(
            "no_match",
            "the robot's map fits the joint map nowhere: are both of the same floor, and does the joint map show enough?",
        )
    # in the end a wall must lie on its counterpart, and not between both faces of it
    _, T = _Climb(own, joint, _FINEST_SIGMA_M).climbed(found[0][1], _STEPS[1:])
    best = _result(own, joint, T, found[0][0])
    _check_overlap(best)
    elsewhere = [(gain, T) for gain, T in found[1:] if not is_same(best.T, T, pivot)]
    if elsewhere and elsewhere[0][0] > _MAX_NEXT_SHARE * best.gain:
        raise _ambiguous(best, *elsewhere[0], pivot)
    return FoundFrame(best.T, best.residual_m, None, "map match", best.n_compared, _sentence(best))


@dataclass(frozen=True, slots=True)
class _Result:
    """A transform, and how well the maps fit by it.

    Attributes:
        n_compared: number of the robot's obstacles that lie where the joint map knows what is there.
        obstacles_m: the same as a length. ``floor_m2``: free floor that both know.
        gain_share: of the gain that would be if all that is compared coincided.
        agreeing_share: share of the robot's obstacles that agree.
        residual_m: root mean square distance of those that agree.
    """

    T: PlanarTransform
    gain: float
    n_compared: int
    obstacles_m: float
    floor_m2: float
    gain_share: float
    agreeing_share: float
    residual_m: float


class _Climb:
    """From coarse results to the next maxima of the gain."""

    def __init__(self, own: MapSide, joint: MapSide, sigma_m: float = _FINE_SIGMA_M) -> None:
        self._own, self._joint = own, joint
        self._p, self._q = _Points.thinned(own.obstacles), _Points.thinned(joint.obstacles)
        # in metres of obstacles: the maps' cells may differ in size
        self._scale_p = len(own.obstacles) / self._p.n * own.cell_m
        self._scale_q = WEIGHT * len(joint.obstacles) / self._q.n * joint.cell_m
        self._field_own, self._field_joint = own.field(sigma_m), joint.field(sigma_m)

    def best(self, starts: list[PlanarTransform]) -> list[tuple[float, PlanarTransform]]:
        """What is reached from some starts, and what it gains; best first. From bad ones only the first steps are made."""
        first = [self.climbed(start, _STEPS[:1]) for start in starts]
        first.sort(key=lambda found: -found[0])
        found = [self.climbed(T, _STEPS) for _, T in first[:_CLIMBED_TO_THE_TOP]] + first[_CLIMBED_TO_THE_TOP:]
        return sorted(found, key=lambda found: -found[0])

    def climbed(self, best: PlanarTransform, steps: tuple[tuple[float, float], ...]) -> tuple[float, PlanarTransform]:
        gain = self._gain(best)
        known = self._joint.sample(self._joint.is_known.astype(np.float32), best.apply(self._own.obstacles)) > 0.5
        # turned about the middle of what is compared, a turn hardly shifts it
        pivot = self._own.obstacles[known if known.any() else slice(None)].mean(axis=0)
        for step_m, step_rad in steps:
            improved = True
            while improved:
                improved = False
                for dx, dy, turn in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)):
                    moved = _moved(best, pivot, dx * step_m, dy * step_m, turn * step_rad)
                    moved_gain = self._gain(moved)
                    if moved_gain > gain:
                        best, gain, improved = moved, moved_gain, True
        return gain, best

    def _gain(self, T: PlanarTransform) -> float:
        of_own = self._p.sum_of(self._field_joint, self._joint.T_frame_cells.inverse() @ T, self._joint.cell_m)
        T_own_building = self._own.T_frame_cells.inverse() @ T.inverse()
        of_joint = self._q.sum_of(self._field_own, T_own_building, self._own.cell_m)
        return of_own * self._scale_p + of_joint * self._scale_q


class _Points:
    """Places whose sum in a layer is needed again and again."""

    def __init__(self, p: _Array) -> None:
        self.n = len(p)
        side = math.ceil(math.sqrt(self.n))  # OpenCV's pictures have at most 32,767 rows
        padded = np.full((side * side, 2), 1e6, np.float32)
        padded[: self.n] = p
        self._x, self._y = (np.ascontiguousarray(padded[:, k].reshape(side, side)) for k in (0, 1))

    @classmethod
    def thinned(cls, p: _Array) -> _Points:
        """``_MAX_POINTS`` of them, evenly chosen."""
        return cls(p[np.linspace(0, len(p) - 1, min(len(p), _MAX_POINTS)).round().astype(int)])

    def sum_of(self, layer: _Layer, T_cells_frame: PlanarTransform, cell_m: float) -> float:
        """The sum of a layer at the places, interpolated; 0 outside of it."""
        c, s = math.cos(T_cells_frame.yaw_rad) / cell_m, math.sin(T_cells_frame.yaw_rad) / cell_m
        col = self._x * np.float32(c) - self._y * np.float32(s) + np.float32(T_cells_frame.x_m / cell_m - 0.5)
        row = self._x * np.float32(s) + self._y * np.float32(c) + np.float32(T_cells_frame.y_m / cell_m - 0.5)
        return float(
            cv2.remap(layer, col, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0.0).sum()
        )


def _result(own: MapSide, joint: MapSide, T: PlanarTransform, gain: float) -> _Result:
    p = T.apply(own.obstacles)
    known = joint.sample(joint.is_known.astype(np.float32), p) > 0.5
    off_m = joint.sample(joint.distance_m, p[known], outside=1e3)
    agrees = off_m <= _AGREES_M
    q_known = own.sample(own.is_known.astype(np.float32), T.inverse().apply(joint.obstacles)) > 0.5
    most = known.sum() * own.cell_m + WEIGHT * q_known.sum() * joint.cell_m
    free = own.T_frame_cells.apply((np.argwhere(own.is_free)[:, ::-1] + 0.5) * own.cell_m)
    both = joint.sample(joint.is_free.astype(np.float32), T.apply(free)) > 0.5
    return _Result(
        T,
        gain,
        int(known.sum()),
        float(known.sum()) * own.cell_m,
        float(both.sum()) * own.cell_m**2,
        gain / max((1.0 - CHANCE) * float(most), 1e-9),
        float(agrees.mean()) if len(agrees) else 0.0,
        float(np.sqrt(np.square(off_m[agrees]).mean())) if agrees.any() else math.inf,
    )


def _moved(T: PlanarTransform, pivot: _Array, dx_m: float, dy_m: float, turn_rad: float) -> PlanarTransform:
    """Turned about where the pivot lies, and shifted."""
    x, y = T.apply(pivot) + np.array([dx_m, dy_m]) - PlanarTransform(0.0, 0.0, T.yaw_rad + turn_rad).apply(pivot)
    return PlanarTransform(float(x), float(y), T.yaw_rad + turn_rad)


def _check_overlap(best: _Result) -> None:
    if best.floor_m2 < _MIN_FLOOR_M2 or best.obstacles_m < _MIN_OBSTACLES_M:
        raise FrameError(
            "too_little_overlap",
            f"only {best.floor_m2:.1f} m² of floor and {best.obstacles_m:.1f} m of walls and furniture are known to both maps: "
            "let the cameras or a robot see more of what the robot's map shows",
        )
    if best.gain_share < _MIN_GAIN_SHARE:
        raise FrameError(
            "no_match",
            f"where the robot's map fits best, {100 * best.agreeing_share:.0f} % of its walls and furniture lie where the "
            "joint map has some, and too many others contradict it: are both of the same floor, and was nothing rebuilt?",
        )


def _ambiguous(best: _Result, gain: float, other: PlanarTransform, pivot: _Array) -> FrameError:
    off_m, off_rad = best.T.difference(other, pivot)
    turned = f" and turned by {math.degrees(off_rad):.0f} degrees" if off_rad > math.radians(2.0) else ""
    return FrameError(
        "ambiguous",
        f"the robot's map fits at two places about as well: {in_words(best.T)}, or {off_m:.1f} m from there{turned} "
        f"({100 * gain / best.gain:.0f} % of the agreement). Rooms look alike: let the robot or the cameras see more, or give "
        "two pairs of places",
    )


def _sentence(best: _Result) -> str:
    return (
        f"By matching the maps, {in_words(best.T)}; {100 * best.agreeing_share:.0f} % of {best.obstacles_m:.0f} m of walls and "
        f"furniture agree, within {100 * best.residual_m:.0f} cm"
    )
