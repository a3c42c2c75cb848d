"""Keepout zones and passages: from the building file, which may change, and from what is said of doors and lifts."""

from __future__ import annotations

import time
from collections.abc import Collection
from pathlib import Path
from typing import Literal

from surveilnav import messages
from surveilnav.building_file import BuildingFile, BuildingFloor, load_building
from surveilnav.bus import Node
from surveilnav.contract import PASSAGE_STATE
from surveilnav.errors import ConfigError
from surveilnav.services.planner.core.motion.areas import Area
from surveilnav.storage import file_stamp

PassageStateName = Literal["open", "closed", "unknown"]

_LOOK_S = 1.0
_MAX_AGE_S = PASSAGE_STATE.max_age_ms / 1000


class BuildingAreas:
    """The areas of each floor, as they are now. Safe to use from any thread but for ``refresh``.

    Raises ConfigError: the file can't be used at the start. Later the zones that were read last stay, and the problem is named.
    """

    def __init__(self, node: Node, path: Path | None) -> None:
        self._node, self._path = node, path
        self._states = node.table(PASSAGE_STATE)
        self._closed_until_s: dict[tuple[str, str], float] = {}
        self._read_s, self._seen = time.monotonic(), file_stamp(path) if path else ()
        self._building: BuildingFile | None = load_building(path) if path else None

    def refresh(self) -> None:
        """Reads the building file again if it has changed."""
        now_s = time.monotonic()
        if self._path is None or now_s - self._read_s < _LOOK_S:
            return
        self._read_s, seen = now_s, file_stamp(self._path)
        if seen == self._seen:
            return
        self._seen = seen
        try:
            self._building = load_building(self._path)
        except ConfigError as error:
            self._node.log.error("building_file: the former keepout zones stay", error=str(error))
            self._node.report_problem("building_file", f"the former keepout zones stay: {error}")
            return
        self._node.report_problem("building_file", "")
        self._node.log.info("read the building file again", zones=sum(len(f.keepout) for f in self._floors().values()))

    def on_floor(self, floor: str, vouched: Collection[str] = ()) -> tuple[Area, ...]:
        """The areas of a floor. ``vouched``: passages that a person says can be passed although they are said to be closed."""
        known = self._floors().get(floor)
        if known is None:
            return ()
        zones = [Area(f"keepout zone {name!r}", "keepout", tuple(outline)) for name, outline in known.keepout.items()]
        for name, passage in known.passages.items():
            state = self.state_of(floor, name)
            if state == "open" or (state == "closed" and name not in vouched):
                zones.append(Area(f"{passage.kind} {name}", state, tuple(passage.outline_m), name))
        return tuple(zones)

    def floors(self) -> list[str]:
        """The floors of which the building file has areas."""
        return [floor for floor, known in self._floors().items() if known.keepout or known.passages]

    def as_messages(self, floor: str) -> list[messages.Area]:
        """The areas of a floor for others, with all passages and their states."""
        if (known := self._floors().get(floor)) is None:
            return []
        zones = [messages.Area(name=n, kind="keepout", outline_m=outline) for n, outline in known.keepout.items()]
        return zones + [
            messages.Area(name=n, kind=p.kind, outline_m=p.outline_m, state=self.state_of(floor, n))
            for n, p in known.passages.items()
        ]

    def state_of(self, floor: str, passage: str) -> PassageStateName:
        """What was last said of a passage: "open" or "closed"; "unknown" if nothing was said lately."""
        row = self._states.get(floor=floor, passage=passage)
        if row is None and time.monotonic() < self._closed_until_s.get((floor, passage), 0.0):
            return "closed"
        if row is None or row.age_s > _MAX_AGE_S:
            return "unknown"
        state: PassageStateName = row.message.state
        return state

    def remember_closed(self, floor: str, passages: Collection[str]) -> None:
        """Passages that were closed before the planner was started again count as closed until something is said of them.

        If nothing is, then for as long as what was said counts.
        """
        until_s = time.monotonic() + _MAX_AGE_S
        self._closed_until_s |= {(floor, passage): until_s for passage in passages}

    def _floors(self) -> dict[str, BuildingFloor]:
        return {} if self._building is None else self._building.floors


class MissionAreas:
    """The areas as one mission takes them. It knows which closed passages a person had it go on at.

    Attributes:
        vouched: these passages, as (floor, passage).
    """

    def __init__(self, areas: BuildingAreas) -> None:
        self._areas = areas
        self.vouched: frozenset[tuple[str, str]] = frozenset()

    def drop_outdated_vouches(self) -> None:
        """Forgets what a person said of passages that are said to be open now: once they close again, that is news."""
        self.vouched = frozenset(v for v in self.vouched if self._areas.state_of(*v) != "open")

    def on_floor(self, floor: str) -> tuple[Area, ...]:
        """The areas of a floor, without the passages that a person says can be passed."""
        return self._areas.on_floor(floor, {passage for there, passage in self.vouched if there == floor})

    def remember_closed(self, floor: str, passages: Collection[str]) -> None:
        """Passages that were closed before the planner was started again."""
        self._areas.remember_closed(floor, passages)

    def are_closed(self, floor: str, passages: Collection[str]) -> bool:
        """Whether all of these passages are said to be closed."""
        return all(self._areas.state_of(floor, name) == "closed" for name in passages)

    def vouch(self, floor: str, passages: Collection[str]) -> None:
        """A person says that these passages can be passed."""
        self.vouched |= {(floor, passage) for passage in passages}
