"""Keepout zones, doors and lifts: resources from what the planner tells. It can be anything, so what can't be is left out."""

from __future__ import annotations

from math import isfinite

from surveilnav.geometry.polygon import MAX_CORNERS
from surveilnav.messages import Area, FloorAreas
from surveilnav.messages.area import MAX_ENTRIES, MAX_M, MAX_NAME
from surveilnav.rest import Area as AreaResource
from surveilnav.services.gateway.core.resources import utc

#: Zones and passages.
_MAX_AREAS = 2 * MAX_ENTRIES


def areas_from_message(message: FloorAreas, seen_ns: int, *, stale: bool) -> tuple[list[AreaResource], list[str]]:
    """The areas of a floor, and why others were left out."""
    faults = [f"{len(message.areas)} areas, at most {_MAX_AREAS} are shown"] if len(message.areas) > _MAX_AREAS else []
    found: dict[str, AreaResource] = {}
    for area in message.areas[:_MAX_AREAS]:
        id = f"{message.floor}/{area.kind}/{area.name:.{MAX_NAME}}"
        if fault := _fault_of(area) or ("it is there twice" if id in found else ""):
            faults.append(f"{area.kind} {area.name[:MAX_NAME]!r}: {fault}")
            continue
        found[id] = AreaResource(
            id=id,
            floor=message.floor,
            name=area.name,
            kind=area.kind,
            state=(area.state or "unknown") if area.kind != "keepout" else None,
            outline_m=area.outline_m,
            last_seen=utc(seen_ns),
            stale=stale,
        )
    return list(found.values()), faults


def _fault_of(area: Area) -> str:
    if not 1 <= len(area.name) <= MAX_NAME:
        return f"expected a name of 1 to {MAX_NAME} characters, got {len(area.name)}"
    if not 3 <= len(area.outline_m) <= MAX_CORNERS:
        return f"expected 3 to {MAX_CORNERS} corners, got {len(area.outline_m)}"
    if not all(isfinite(v) and abs(v) <= MAX_M for corner in area.outline_m for v in corner):
        return f"expected finite corners, at most {MAX_M:g} m away"
    return ""
