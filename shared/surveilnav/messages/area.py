"""Keepout zones, doors and lifts of a floor, as the planner takes them."""

from __future__ import annotations

from typing import Literal

import msgspec

from surveilnav.messages.base import Message

#: Limits of what a building file may have, and of what is believed of one: floors, zones of a floor and passages of a floor
#: each; characters of a name; how far the building reaches from its origin [m].
MAX_ENTRIES, MAX_NAME, MAX_M = 200, 100, 1e5


class Area(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A place where no robot is sent, or a passage that is open or closed.

    Attributes:
        name: of a zone for people, of a passage in the system that opens it.
        outline_m: corners (x, y) [m, world].
        state: of a passage, as it was last said to be; "": it is a zone.
    """

    name: str
    kind: Literal["keepout", "door", "lift"]
    outline_m: list[tuple[float, float]]
    state: Literal["", "open", "closed", "unknown"] = ""


class FloorAreas(Message, frozen=True, kw_only=True):
    """All areas of a floor. On change."""

    floor: str
    areas: list[Area]
