"""Which levels of a plan are floors that one walks on, and on which floor the others count."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from surveilnav.simulator.plans.sweethome import Level
from surveilnav.simulator.plans.words import ROOF
from surveilnav.simulator.world.scene import Floor

#: Nobody walks on a level lower than this [m]: a false ceiling, a crawl space.
MIN_HEIGHT_M = 1.5
#: Levels that lie this close are one floor [m]; a plan's centimetres are off by a rounding error.
_SAME_M, _ROUNDING_M = 0.1, 1e-6
#: The ground floor is the first that lies higher than this [m].
_GROUND_M = -0.3


def at_one_altitude(a_m: float, b_m: float) -> bool:
    """Whether two levels are one floor by their altitudes."""
    return abs(a_m - b_m) <= _SAME_M + _ROUNDING_M


def why_no_storey(level: Level, *, roomed: bool, walled: bool, furnished: bool, is_below: bool) -> str:
    """Why a level is no floor, for people; empty if it may be one.

    Args:
        roomed: whether a room is drawn on it; ``walled``: whether walls stand on it; ``furnished``: whether furniture or a
            door does; ``is_below``: whether a floor lies above it.
    """
    if level.height_m < MIN_HEIGHT_M:
        return f"it is {level.height_m:.2g} m high, and nobody walks on less than {MIN_HEIGHT_M:g} m"
    if ROOF.search(level.name) and not (roomed and furnished):
        return "its name says roof, and nothing stands in a room on it"
    if not roomed and not walled:
        return "neither rooms nor walls are drawn on it"
    if roomed or furnished or is_below:
        return ""
    return "nothing stands between its walls, and no room is drawn: they are taken for a roof's"


def is_low_or_roof(level: Level) -> bool:
    """Whether a level is one that people walk on least of all."""
    return level.height_m < MIN_HEIGHT_M or bool(ROOF.search(level.name))


def is_upper(floor: Floor) -> bool:
    """Whether a floor lies above the one on the ground."""
    return floor.id.isdigit() and floor.id != "0"


def number_storeys(levels: Sequence[Level], used: Collection[str]) -> tuple[list[Floor], dict[str, str]]:
    """Floors from the lowest up: "0" on the ground, "1" above, "B1" below; and the floor of every level.

    Levels at one altitude are one floor. What is no floor (a roof, a false ceiling) counts to the floor below it.

    Args:
        levels: of the plan, at least one.
        used: ids of those that are floors (``why_no_storey``), at least one.
    """
    ordered = sorted(levels, key=lambda level: level.z_m)
    storeys: list[list[Level]] = []
    for level in ordered:
        if level.id not in used:
            continue
        if storeys and at_one_altitude(level.z_m, storeys[-1][0].z_m):
            storeys[-1].append(level)
        else:
            storeys.append([level])
    ground = next((i for i, group in enumerate(storeys) if group[0].z_m > _GROUND_M), len(storeys) - 1)
    floors = []
    for i, (first, *_) in enumerate(storeys):
        floor_id = str(i - ground) if i >= ground else f"B{ground - i}"
        floors.append(Floor(floor_id, first.name or floor_id, first.z_m, first.height_m))
    floor_of = {}
    for level in ordered:
        below = [f for f in floors if f.z_m <= level.z_m or at_one_altitude(f.z_m, level.z_m)]
        floor_of[level.id] = (below[-1] if below else floors[0]).id
    return floors, floor_of
