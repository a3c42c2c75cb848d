"""Floor plans and Nav2's maps: whether they can be read, and lie where the building is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from surveilnav.building_file import BuildingFloor
from surveilnav.camera_pose import FloorPlan, load_floor_plan
from surveilnav.cli.building_check.files import Files
from surveilnav.cli.finding import Finding
from surveilnav.errors import ConfigError
from surveilnav.robot_frame.nav2_map import FREE, load_nav2_map

#: Things may stand so far beyond the edge of a plan.
_MARGIN_M = 1.0


@dataclass(frozen=True, slots=True)
class Extent:
    """The rectangle along the building's axes that holds a floor plan [m]."""

    x0: float
    y0: float
    x1: float
    y1: float

    def holds(self, x: float, y: float) -> bool:
        return self.x0 - _MARGIN_M <= x <= self.x1 + _MARGIN_M and self.y0 - _MARGIN_M <= y <= self.y1 + _MARGIN_M

    def __str__(self) -> str:
        return f"x {self.x0:.1f} to {self.x1:.1f} m, y {self.y0:.1f} to {self.y1:.1f} m"


def check_floors(files: Files) -> tuple[dict[str, Extent], list[Finding]]:
    """Reads plans and maps. Returns how far the plans reach, by floor, and what was found."""
    extents: dict[str, Extent] = {}
    findings: list[Finding] = []
    for name, floor in files.building.floors.items():
        if floor.plan is not None:
            findings.append(_check_plan(files, name, floor, extents))
        if floor.nav2_map is not None:
            findings.append(_check_map(files, name, floor, extents.get(name)))
        if (extent := extents.get(name)) is not None:
            findings += _outside(files, name, floor, extent)
    return extents, findings


def _check_plan(files: Files, name: str, floor: BuildingFloor, extents: dict[str, Extent]) -> Finding:
    assert floor.plan is not None
    what, shown = f"floor {name}, plan", files.shown(floor.plan)
    if floor.plan.suffix.lower() not in (".yaml", ".yml"):
        if not floor.plan.is_file():
            return Finding(what, "problem", f"there is no file {shown}", "lay it there, or correct its name")
        told = f"{shown} doesn't say its scale"
        return Finding(
            what, "note", told, "name a map.yaml, on which cameras can be calibrated (docs/use/calibration.md)"
        )
    try:
        plan = load_floor_plan(floor.plan)
    except ConfigError as error:
        return Finding(what, "problem", str(error), "correct it there")
    extents[name] = extent = _extent_of(plan)
    return Finding(what, "ok", f"{shown}, {extent}")


def _extent_of(plan: FloorPlan) -> Extent:
    right, bottom = plan.width_px - 0.5, plan.height_px - 0.5
    corners = plan.world_of(np.array([(-0.5, -0.5), (right, -0.5), (right, bottom), (-0.5, bottom)]))
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    return Extent(float(x0), float(y0), float(x1), float(y1))


def _check_map(files: Files, name: str, floor: BuildingFloor, plan: Extent | None) -> Finding:
    assert floor.nav2_map is not None
    assert floor.T_building_map is not None
    what, shown = f"floor {name}, Nav2's map", files.shown(floor.nav2_map)
    try:
        read = load_nav2_map(floor.nav2_map)
    except ConfigError as error:
        return Finding(what, "problem", str(error), "correct it there")
    free = read.places(FREE)
    if not len(free):
        return Finding(what, "problem", f"{shown} has no free cell", "check free_thresh, negate and the picture")
    area_m2 = len(free) * read.resolution_m**2
    p_building = floor.T_building_map.transform().apply(free)
    if plan is not None:
        inside = np.mean([plan.holds(float(x), float(y)) for x, y in p_building[:: max(1, len(free) // 1000)]])
        if inside < 0.5:
            told = f"{100 * (1 - inside):.0f} % of its free floor lie outside the floor plan ({plan})"
            return Finding(what, "problem", told, f"correct T_building_map of floor {name} in {files.path}")
    return Finding(what, "ok", f"{shown}, {area_m2:.0f} m² of free floor")


def _outside(files: Files, name: str, floor: BuildingFloor, extent: Extent) -> list[Finding]:
    outlines = {f"keepout {place!r}": outline for place, outline in floor.keepout.items()}
    outlines |= {f"passage {id}": passage.outline_m for id, passage in floor.passages.items()}
    remedy = f"correct it in {files.path}"
    return [
        Finding(f"floor {name}", "problem", f"{what} lies outside the floor plan ({extent})", remedy)
        for what, outline in outlines.items()
        if not any(extent.holds(x, y) for x, y in outline)
    ]
