"""Reads what the building file says of its floors: Nav2's maps, which the joint maps begin with."""

from __future__ import annotations

from pathlib import Path

from surveilnav.building_file import load_building
from surveilnav.errors import ConfigError
from surveilnav.robot_frame import load_nav2_map
from surveilnav.services.fusion.core.maps.prior import PriorMap


def load_priors(building_file: str, max_extent_m: float) -> dict[str, PriorMap]:
    """By floor, the map that the building file names; empty without a file.

    Raises:
        ConfigError: the file, or a map that it names, can't be read or used.
    """
    if not building_file:
        return {}
    path = Path(building_file).expanduser()
    priors = {}
    for floor, entry in load_building(path).floors.items():
        if entry.nav2_map is None or entry.T_building_map is None:
            continue
        prior = PriorMap(load_nav2_map(entry.nav2_map), entry.T_building_map.transform())
        x0, y0, x1, y1 = prior.extent()
        if max(x1 - x0, y1 - y0) > max_extent_m:
            raise ConfigError(
                f"{path}: the map of floor {floor} is {x1 - x0:.0f} x {y1 - y0:.0f} m; joint maps have at most "
                f"{max_extent_m:g} m (SURVEILNAV_FUSION__MAP__MAX_EXTENT_M). Is its resolution right?"
            )
        priors[floor] = prior
    return priors
