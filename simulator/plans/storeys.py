"""Which levels of a plan are floors that one walks on, and on which floor the others count."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from simulator.plans.sweethome import Level
from simulator.plans.words import ROOF
from simulator.world.scene import Floor

#: Nobody walks on a level lower than this [m]: a false ceiling, a crawl space.
MIN_HEIGHT_M = 1.5
#: Levels that lie this close are one floor [m].
SAME_M = 0.1
#: The ground floor is the first that lies higher than this [m].
_GROUND_M = -0.3


def is_storey(level: Level) -> bool:
    """Whether a level can be a floor at all: high enough, and no roof by its name."""
    return level.height_m >= MIN_HEIGHT_M and not ROOF.search(level.name)


def number_storeys(levels: Sequence[Level], used: Collection[str]) -> tuple[list[Floor], dict[str, str]]:
    """Floors from the lowest up: "0" on the ground, "1" above, "B1" below; and the floor of every level.

    Levels at one altitude are one floor. What is no floor (a roof, a false ceiling) counts to the floor below it.

    Args:
        levels: of the plan, at least one.
        used: ids of the levels that have rooms, or walls that aren't just a roof's.
    """
    ordered = sorted(levels, key=lambda level: level.z_m)
    storeys: list[list[Level]] = []
    for level in ordered:
        if level.id not in used or not is_storey(level):
            continue
        if storeys and level.z_m - storeys[-1][0].z_m < SAME_M:
            storeys[-1].append(level)
        else:
            storeys.append([level])
    if not storeys:
        storeys = [[next((level for level in ordered if is_storey(level)), ordered[0])]]
    ground = next((i for i, group in enumerate(storeys) if group[0].z_m > _GROUND_M), len(storeys) - 1)
    floors = []
    for i, (first, *_) in enumerate(storeys):
        floor_id = str(i - ground) if i >= ground else f"B{ground - i}"
        floors.append(Floor(floor_id, first.name or floor_id, first.z_m, first.height_m))
    floor_of = {}
    for level in ordered:
        below = [floor for floor in floors if floor.z_m <= level.z_m + SAME_M]
        floor_of[level.id] = (below[-1] if below else floors[0]).id
    return floors, floor_of
