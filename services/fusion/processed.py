"""What the joint maps have processed of whom, beside the maps themselves."""

from __future__ import annotations

from typing import Any

from surveilnav.services.fusion.records import LastObservation, PerceivedView, ViewKey


class MapContents:
    """Observations and views that are processed: the maps hold them, or have refused them for good.

    Attributes:
        robots: newest processed observation by robot.
        views: processed views by camera: nobody needs to wait for them any more.
        digests: of the cameras' views that the maps hold.
        troubles: why the newest picture of a view was refused.
    """

    def __init__(self) -> None:
        self.robots: dict[str, LastObservation] = {}
        self.views: dict[str, set[int]] = {}
        self.digests: dict[ViewKey, bytes] = {}
        self.troubles: dict[ViewKey, str] = {}

    def holds(self, key: ViewKey, digest: bytes) -> bool:
        """Whether the maps hold this very picture of a camera. May be asked from any thread."""
        return bool(digest) and key[0].startswith("camera/") and self.digests.get(key) == digest

    def views_of(self, camera: str) -> set[int]:
        """The processed views of a camera."""
        return self.views.get(camera, set())

    def repeats_fault(self, perceived: PerceivedView) -> bool:
        """Whether a camera's view has the fault that it had before."""
        key, fault = perceived.key, perceived.fault
        return bool(fault) and key[0].startswith("camera/") and self.troubles.get(key) == _trouble(perceived, fault)

    def note(self, perceived: PerceivedView, floor: str, refused: str, *, taken: bool) -> None:
        """Notes a view as processed. ``taken``: the maps hold it. ``floor``: "" if unknown."""
        kind, _, name = perceived.key[0].partition("/")
        header = perceived.header
        if kind == "robot":
            known = self.robots.get(name)
            floor = floor or (known.floor if known else header.floor)
            self.robots[name] = LastObservation(floor, header.seq, header.stamp_ns)
        else:
            self.views.setdefault(name, set()).add(perceived.key[1])
            if taken and perceived.digest:
                self.digests[perceived.key] = perceived.digest
        self.troubles.pop(perceived.key, None)
        if refused:
            self.troubles[perceived.key] = _trouble(perceived, refused)

    def state(self) -> dict[str, Any]:
        """All of it, as plain values, for ``from_state``."""
        return {
            "robots": {name: [r.floor, r.seq, r.stamp_ns] for name, r in self.robots.items()},
            "views": {name: sorted(views) for name, views in self.views.items()},
            "digests": [[*key, digest] for key, digest in self.digests.items()],
            "troubles": [[*key, why] for key, why in self.troubles.items()],
        }

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> MapContents:
        """What ``state`` describes."""
        contents = cls()
        contents.robots = {name: LastObservation(*fields) for name, fields in state["robots"].items()}
        contents.views = {name: set(views) for name, views in state["views"].items()}
        contents.digests = {(source, view): digest for source, view, digest in state["digests"]}
        contents.troubles = {(source, view): why for source, view, why in state["troubles"]}
        return contents


def _trouble(perceived: PerceivedView, fault: str) -> str:
    source, view = perceived.key
    which = perceived.header.seq if source.startswith("robot/") else view
    return f"view {which} of {source} was refused: {fault}"
