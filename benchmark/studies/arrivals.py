"""In which order the running system's maps took views, and how many of them they held when the planner decided.

A recording of a search says it. So a search can be played in one process with the same views in the maps at each decision:
what is decided then can differ by the program alone, not by timing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.play.sight import Sight, Sighted
from services.fusion.core import JointMap
from services.recorder.recorded import Heard, told
from surveilnav.contract import MAP_REVISION, MISSION_PLAN, VIEW_LOG


class Arrivals(NamedTuple):
    """Views in the order of fusion's log, and what the planner was told.

    Attributes:
        views: source ("camera/<id>" or "robot/<id>") and index of each.
        told: by the number of the robot's observation, the last revision of the maps before the planner decided on it, and how
            many cameras' views were still to come then.
    """

    views: tuple[tuple[str, int], ...]
    told: Mapping[int, tuple[int, int]]

    def as_row(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {"views": self.views, "told": [[seq, *said] for seq, said in sorted(self.told.items())]}

    @classmethod
    def of_row(cls, row: Mapping[str, Any]) -> Arrivals:
        """What ``as_row`` made."""
        views = tuple((str(source), int(view)) for source, view in row["views"])
        return cls(views, {seq: (revision, pending) for seq, revision, pending in row["told"]})


def arrivals_of(recording: Path, robot: str) -> Arrivals:
    """What a recording says of them.

    Raises:
        RecordingError: it is no recording of this program.
    """
    views: dict[int, tuple[str, int]] = {}
    said: dict[int, tuple[int, int]] = {}
    decided: set[int] = set()
    for heard in told(recording):
        if not isinstance(heard, Heard):
            continue
        message = heard.message
        if heard.stream is VIEW_LOG and message.number:
            views[message.number] = message.source, message.view
        elif heard.stream is MISSION_PLAN and message.robot == robot:
            decided.add(message.seq)
        elif heard.stream is MAP_REVISION and (seq := message.robots.get(robot)) is not None and seq not in decided:
            said[seq] = message.revision, message.pending_views
    return Arrivals(tuple(views[number] for number in sorted(views)), said)


class RecordedCameras:
    """The cameras of a search whose views come as they came in the running system (``benchmark.play.cameras.Cameras``)."""

    offered_bytes: Mapping[str, int] = {}

    def __init__(self, sight: Sight, arrivals: Arrivals) -> None:
        self._sight, self._told, self._views = sight, arrivals.told, iter(arrivals.views)
        self.n_pending = 0

    def invoke(self, floor_z_m: float, now: int) -> tuple[str, ...]:
        """Nobody: who was invoked, and when, is in the order of the views."""
        return ()

    def in_turn(self, joint: JointMap, seen: Sighted, arrived: tuple[str, ...]) -> Iterator[Sighted]:
        """This step's views in the order of the log, until the maps are as they were when the planner was told of them."""
        revision, self.n_pending = self._told.get(seen.view.seq, (joint.revision, 0))
        for source, view in self._views:
            if source == seen.view.source:
                break
            yield self._of_camera(source, view)
        yield seen
        while joint.revision < revision and (more := next(self._views, None)):
            yield self._of_camera(*more)

    def _of_camera(self, source: str, view: int) -> Sighted:
        views = self._sight.camera(source.removeprefix("camera/"))
        return next(seen for seen in views if seen.view.view == view)
