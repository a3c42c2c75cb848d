"""Objects as goals: which to go to, where to stand, and when to believe."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from services.planner.core import memory
from services.planner.core.settings import PlannerConfig
from services.planner.core.state import MissionState, RobotView
from services.planner.core.terrain import Terrain, clear_lines
from surveilnav.messages import ObjectRecord

Verdict = Literal["verified", "open", "contradicted"]
#: Higher than this above the floor an object stands on something, which reaches at most so far from it.
_RAISED_M = 0.3
_FURNITURE_M = 0.9
#: Seen from one side only: the mean direction is at least so long (1: all from one direction).
_ONE_SIDE = 0.5
#: The farthest ring before an object that counts as before it, and how much longer a way may be that leads nearer.
_RING_M = 0.95
_NEARER_M = 0.75
#: What lies lower above the floor is the floor, if at least so much of an object is higher.
_FLOOR_M = 0.10
_MOST_OF = 0.5
#: An object that the robot is on its way to stays promising down to this share of what made it so.
_HELD = 0.6


@dataclass(frozen=True, slots=True, eq=False)
class Standoff:
    """Where to stand to have reached an object.

    Attributes:
        goals: bool of the terrain's shape, cells to stand on: as near as a way leads that is no detour, the object in sight.
        distance_m: float32 of the terrain's shape, plan distance of every cell to the object's nearest point; inf where
            that is farther than anybody asks for.
        sight: bool of the terrain's shape: nothing known stands between the cell and the object
            (reachable cells within ``farthest_stop_m`` of it, and the robot's own within ``inspect_m``).
        nearest_m: distance of the ring that the goals lie on.
    """

    goals: NDArray[np.bool_]
    distance_m: NDArray[np.float32]
    sight: NDArray[np.bool_]
    nearest_m: float


def footprint(record: ObjectRecord, floor_z_m: float) -> NDArray[np.float64]:
    """Plan points (N, 2) [m, world] of an object, without the floor next to it, that masks take in, and without the
    outermost tenth: stray depth pixels reach far. ``floor_z_m``: altitude of the floor.

    An object without points has the corners and the centre of its box.
    """
    whole = len(record.points) // 12 * 12
    p_world = np.frombuffer(record.points[:whole], dtype=np.float32).reshape(-1, 3).astype(np.float64)
    p_world = p_world[np.isfinite(p_world).all(axis=1)]
    above = p_world[:, 2] > floor_z_m + _FLOOR_M
    points = p_world[above if np.count_nonzero(above) >= _MOST_OF * len(p_world) else slice(None), :2]
    if len(points) < 4:
        (x, y, _), (w, d, _) = record.center_m, record.size_m
        return np.array([(x + i * w / 2, y + j * d / 2) for i in (-1, 0, 1) for j in (-1, 0, 1)])
    away = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    trimmed: NDArray[np.float64] = points[away <= np.quantile(away, 0.9)]
    return trimmed


def targets_of(
    objects: Iterable[ObjectRecord], state: MissionState, config: PlannerConfig, *, weak: bool = False
) -> list[ObjectRecord]:
    """Objects that may be the target: confirmed ones, then promising candidates; with ``weak`` all candidates.

    What was judged not to be the target stays out, also under a new id at the same place, unless the robot
    itself has confirmed it since, or settled for it.
    """
    found = []
    for record, confirmed in _may_be(objects, state.target):
        if record.id == state.here.settled_for:
            found.append(record)
            continue
        if record.status == "rejected":
            continue
        held = state.commitment is not None and state.commitment.object_id == record.id
        enough = config.promising_chance * (_HELD if held else 1.0)
        if not (confirmed or weak or chance(record, state.target, config) >= enough):
            continue
        if record.id in state.here.dropped:
            continue
        if _near_dropped(record, state, config) and not robot_sees(record, state.target, config):
            continue
        found.append(record)
    return sorted(found, key=lambda o: (not is_confirmed(o, state.target), -relevance(o, state.target)))


def last_resorts(objects: Iterable[ObjectRecord], state: MissionState, config: PlannerConfig) -> list[ObjectRecord]:
    """What may be taken for the target when nothing else is left, likeliest first: objects of this floor with a chance of
    ``settle_chance`` that nobody judged yet, or that the robot itself takes for the target though they were rejected or
    dropped (detectors that see a couch from afar and a bed from near by make fusion reject what it is). What was given
    up for good stays so. The one settled for stays, whatever more views say.
    """
    found = []
    for record, confirmed in _may_be(objects, state.target):
        held = record.id == state.here.settled_for
        if not held and was_judged(record, state, config) and record.label_robot != state.target:
            continue
        if memory.is_given_up(state, *record.center_m[:2], config, confirmed=confirmed):
            continue
        sure = min(1.0, chance(record, state.target, config))  # above 1: a preset's way to say "before all else"
        if held or sure >= config.settle_chance:
            found.append((-sure, record.id, record))
    return [record for _, _, record in sorted(found, key=lambda f: f[:2])]


def _may_be(objects: Iterable[ObjectRecord], target: str) -> Iterator[tuple[ObjectRecord, bool]]:
    """Objects that some view called the target and that aren't surely something else; whether each is confirmed."""
    for record in objects:
        confirmed = is_confirmed(record, target)
        if _named(record, target) and _finite(record) and (confirmed or record.status != "confirmed"):
            yield record, confirmed


def was_judged(record: ObjectRecord, state: MissionState, config: PlannerConfig) -> bool:
    """Whether fusion rejected an object, or the robot dropped it or another at its place."""
    return record.status == "rejected" or record.id in state.here.dropped or _near_dropped(record, state, config)


def is_confirmed(record: ObjectRecord, target: str) -> bool:
    """Fusion calls it confirmed, and by the target's name."""
    return record.status == "confirmed" and record.label == target


def relevance(record: ObjectRecord, target: str) -> float:
    """How much speaks for the object being the target, 0-1; what isn't a share says nothing."""
    scores = record.label_scores.get(target, 0.0), record.confidence if record.label == target else 0.0
    return max(s if 0.0 <= s <= 1.0 else 0.0 for s in scores)


def chance(record: ObjectRecord, target: str, config: PlannerConfig) -> float:
    """About how often such an object turns out to be the target, 0-1, as measured on training buildings."""
    doubt = config.single_shift if record.n_detections == 1 else 0.0
    doubt += config.other_shift if record.label != target else 0.0
    sure = chance_of(relevance(record, target) - doubt, target, config)
    return max(sure, config.confirmed_chance) if is_confirmed(record, target) else sure


def chance_of(relevance: float, target: str, config: PlannerConfig) -> float:
    """The same for what was seen several times and looks most like the target, by its relevance."""
    even = config.even_relevances.get(target, config.even_relevance)
    return 1.0 / (1.0 + math.exp((even - relevance) / config.relevance_scale))


def robot_sees(record: ObjectRecord, target: str, config: PlannerConfig) -> bool:
    """Whether the robot's own views call it the target, surely enough."""
    return record.label_robot == target and record.confidence_robot >= config.verify_confidence_robot


def verdict(record: ObjectRecord, target: str, config: PlannerConfig) -> Verdict:
    """The first level of verification: what the joint map says now.

    ``verified``: confirmed by fusion and, unless ``verification`` is ``paper``, seen as the target by the robot.
    ``contradicted``: rejected, or the robot surely sees something else and all views together do, too: one robot view
    doesn't outweigh what several cameras saw. ``open``: look once more.
    """
    if record.status == "rejected":
        return "contradicted"
    if config.verification == "paper":
        return "verified" if is_confirmed(record, target) else "open"
    if robot_sees(record, target, config) and is_confirmed(record, target):
        return "verified"
    another = target not in (record.label, record.label_robot) and record.label_robot != ""
    if another and record.confidence_robot >= config.verify_confidence_robot:
        return "contradicted"
    return "open"


def good_enough(record: ObjectRecord, target: str, config: PlannerConfig) -> bool:
    """The second level, when looking again is no use: strong surveillance that no robot view contradicts."""
    return (
        is_confirmed(record, target)
        and record.label_surveillance == target
        and record.confidence_surveillance >= config.strong_confidence_surveillance
        and record.n_detections >= config.strong_detections
        and record.label_robot in ("", target)
    )


def standoff(
    terrain: Terrain, arrival: NDArray[np.float64], record: ObjectRecord, robot: RobotView, config: PlannerConfig,
    floor_z_m: float = 0.0,
) -> Standoff | None:  # fmt: skip
    """Where to stand before an object; None if no way leads within ``farthest_stop_m`` of it.

    Rings are tried from near to far, one farther off only if the way there is clearly shorter: known ground in sight of
    the object first (over what it stands on where it was seen from one side only), then ground from which only the
    furniture that it stands on is in between, unknown ground while the place hasn't been seen, then the same in places
    that are too tight by the map, by a cell first (maps are thicker than walls by as much), at last known ground without
    sight (a low shelf in between hides nothing from a camera above it). ``arrival``: travel time from the robot (the
    terrain's shape); ``floor_z_m``: altitude of the floor.
    """
    points = footprint(record, floor_z_m)
    cells = terrain.grid.cells_of(points)
    cells = cells[terrain.grid.contains(cells)]
    if not len(cells):
        return None
    near_m = max(config.farthest_stop_m, config.inspect_m, config.standoff_m, config.stop_m, 1.0)
    part = _Part.around(terrain, cells, near_m)
    r = terrain.grid.resolution_m
    mask = np.ones(part.shape, dtype=np.uint8)
    mask[cells[:, 0] - part.row0, cells[:, 1] - part.col0] = 0
    distance, nearest = cv2.distanceTransformWithLabels(mask, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    distance_m = (distance * r).astype(np.float32)
    way_m = arrival[part.window]
    reachable = np.isfinite(way_m)
    near = reachable & (distance_m <= config.farthest_stop_m)
    if (here := part.cell(terrain.cell(robot.x_m, robot.y_m))) is not None:
        near[here] = distance_m[here] <= config.inspect_m
    first = over = sight = _sight(terrain, part, mask, nearest, near, points)
    if record.center_m[2] - record.size_m[2] / 2 - floor_z_m >= _RAISED_M:
        # a wall isn't furniture: what hangs on its other side is seen from there only
        one_side = math.hypot(*record.seen_from) >= _ONE_SIDE
        before = near & _on_the_side_seen(terrain, part, record) if one_side else near
        over = sight | _sight(terrain, part, mask, nearest, before, points, _FURNITURE_M)
        first = over if one_side else sight
    known = terrain.known[part.window]
    clearance_m = terrain.clearance_m[part.window]
    roomy, nearly = (clearance_m >= config.robot_radius_m - short_m for short_m in (0.0, r))
    rings_m = config.standoff_m, config.stop_m, _RING_M
    for tries_m, ground in (
        (rings_m, first & known & roomy), (rings_m, over & known & roomy), ((_RING_M,), sight & roomy),
        (rings_m, sight & known & nearly), (rings_m, over & known & nearly), (rings_m, sight & known),
        ((_RING_M,), sight), ((config.farthest_stop_m,), over & known), ((1.0,), known & roomy), ((1.0,), known),
    ):  # fmt: skip
        places = [(ring_m, ground & reachable & (distance_m <= ring_m)) for ring_m in tries_m]
        ways_m = [float(way_m[goals].min(initial=math.inf)) for _, goals in places]
        for (ring_m, goals), least_m in zip(places, ways_m, strict=True):
            if math.isfinite(least_m) and least_m <= ways_m[-1] + _NEARER_M:
                far_m = np.float32(np.inf)
                return Standoff(
                    part.whole(goals, False), part.whole(distance_m, far_m), part.whole(over, False), ring_m
                )
    return None


class _Part(NamedTuple):
    """A window of a terrain; ``row0``, ``col0``: its corner in it."""

    terrain: Terrain
    row0: int
    col0: int
    shape: tuple[int, int]

    @classmethod
    def around(cls, terrain: Terrain, cells: NDArray[np.int64], margin_m: float) -> _Part:
        """All within ``margin_m`` of cells (n, 2), and a little more."""
        margin = math.ceil(margin_m / terrain.grid.resolution_m) + 2
        low = np.maximum(cells.min(axis=0) - margin, 0)
        high = np.minimum(cells.max(axis=0) + margin + 1, terrain.grid.shape)
        return cls(terrain, int(low[0]), int(low[1]), (int(high[0] - low[0]), int(high[1] - low[1])))

    @property
    def window(self) -> tuple[slice, slice]:
        """What to take of an array of the terrain's shape."""
        return slice(self.row0, self.row0 + self.shape[0]), slice(self.col0, self.col0 + self.shape[1])

    def cell(self, cell: tuple[int, int]) -> tuple[int, int] | None:
        """A cell of the terrain in this window; None: it lies outside."""
        row, col = cell[0] - self.row0, cell[1] - self.col0
        return (row, col) if 0 <= row < self.shape[0] and 0 <= col < self.shape[1] else None

    def whole(self, values: NDArray[Any], outside: Any) -> NDArray[Any]:
        """An array of the terrain's shape."""
        array = np.full(self.terrain.grid.shape, outside, dtype=values.dtype)
        array[self.window] = values
        return array


def _on_the_side_seen(terrain: Terrain, part: _Part, record: ObjectRecord) -> NDArray[np.bool_]:
    """Cells (the part's shape) on the side of an object from which it was seen."""
    x, y = record.seen_from
    rows, cols = np.indices(part.shape, sparse=True)
    r, grid = terrain.grid.resolution_m, terrain.grid
    along_x = (grid.origin_x_m + (cols + part.col0 + 0.5) * r - record.center_m[0]) * x
    along_y = (grid.origin_y_m + (rows + part.row0 + 0.5) * r - record.center_m[1]) * y
    return np.asarray(along_x + along_y > 0.0)


def _sight(
    terrain: Terrain, part: _Part, mask: NDArray[np.uint8], nearest: NDArray[np.int32], near: NDArray[np.bool_],
    points: NDArray[np.float64], furniture_m: float = 0.0,
) -> NDArray[np.bool_]:  # fmt: skip
    """For cells of the part in ``near``: whether the straight line to the object's nearest cell is free of obstacles, but
    for those next to the object that reach no farther than ``furniture_m``.

    Obstacles inside the object's own box (one cell wider) are the object itself. ``nearest`` labels the zero cells of
    ``mask`` as OpenCV numbers them.
    """
    r = terrain.grid.resolution_m
    of_label = np.zeros((int(nearest.max()) + 1, 2), dtype=np.int64)
    zeros = np.argwhere(mask == 0)
    of_label[nearest[zeros[:, 0], zeros[:, 1]]] = zeros
    start = np.argwhere(near)
    end = of_label[nearest[start[:, 0], start[:, 1]]]

    obstacles = terrain.occupied[part.window].copy()
    row0, col0 = terrain.grid.cells_of(points.min(axis=0) - r) - (part.row0, part.col0)
    row1, col1 = terrain.grid.cells_of(points.max(axis=0) + r) - (part.row0, part.col0)
    obstacles[max(0, row0) : row1 + 1, max(0, col0) : col1 + 1] = False
    sight = np.zeros(part.shape, dtype=bool)
    sight[start[:, 0], start[:, 1]] = clear_lines(obstacles, start, end, furniture_m / r)
    return sight


def _named(record: ObjectRecord, target: str) -> bool:
    names = record.label, record.label_robot, record.label_surveillance
    return target in names or record.label_scores.get(target, 0.0) > 0.0


def _finite(record: ObjectRecord) -> bool:
    return all(math.isfinite(v) for v in (*record.center_m, *record.size_m))


def _near_dropped(record: ObjectRecord, state: MissionState, config: PlannerConfig) -> bool:
    return any(
        math.hypot(record.center_m[0] - x, record.center_m[1] - y) < config.same_place_m
        for x, y, _ in state.here.dropped.values()
    )
