"""Reads from a recording in which order the running system integrated views, and which revision each decision was made on.

With that a search can be played again in one process with the same views in the maps at each decision. If the robot then acts
otherwise, the programs differ, not the timing.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from surveilnav.benchmark.play.sight import SeenView, Sight
from surveilnav.contract import MISSION_PLAN, VIEW_LOG
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.recorder.reading import RecordingError
from surveilnav.services.recorder.recorded import RecordedMessage, read_recording


class MapsState(NamedTuple):
    """The revision of the maps, and how many camera views were still waiting for integration."""

    revision: int
    pending_views: int


class Arrivals(NamedTuple):
    """The views of a search in the order of their integration, and the state of the maps at each decision.

    Attributes:
        views: source ("camera/<id>" or "robot/<id>") and index of each, in the order of fusion's log.
        decided_on: the state of the maps of each decision, by the number of the robot's observation.
    """

    views: tuple[tuple[str, int], ...]
    decided_on: Mapping[int, MapsState]

    def to_row(self) -> dict[str, Any]:
        """As plain JSON values."""
        return {"views": self.views, "decided_on": [[seq, *state] for seq, state in sorted(self.decided_on.items())]}

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> Arrivals:
        """Reads what ``to_row`` returned."""
        views = tuple((str(source), int(index)) for source, index in row["views"])
        return cls(views, {seq: MapsState(*state) for seq, *state in row["decided_on"]})


def arrivals_of(recording: Path) -> Arrivals:
    """Reads the recording of a mission.

    Raises:
        RecordingError: it is no recording of this program, or lacks views.
    """
    views, decided_on = dict[int, tuple[str, int] | None](), dict[int, MapsState]()
    for heard in read_recording(recording):
        if not isinstance(heard, RecordedMessage):
            continue
        if heard.stream is VIEW_LOG and heard.message.number:
            view = heard.message
            views[view.number] = None if view.fault else (view.source, view.view)
        elif heard.stream is MISSION_PLAN:
            decided_on[heard.message.seq] = MapsState(heard.message.revision, heard.message.pending_views)
    if not decided_on or sorted(views) != list(range(1, len(views) + 1)):
        raise RecordingError(
            f"expected all views from the first on and what was decided, got {recording}, which lacks some"
        )
    return Arrivals(tuple(view for _, view in sorted(views.items()) if view), decided_on)


class RecordedCameras:
    """The cameras of a search whose views come as they came in the running system (``play.cameras.Cameras``)."""

    offered_bytes: Mapping[str, int] = {}

    def __init__(self, sight: Sight, arrivals: Arrivals) -> None:
        self._sight, self._decided_on = sight, arrivals.decided_on
        self._log, self._seq = deque(arrivals.views), -1
        self.n_pending = 0

    def invoke(self, floor_z_m: float, now: int) -> tuple[str, ...]:
        """Nobody: who was invoked, and when, is in the order of the views."""
        return ()

    def in_turn(self, joint: JointMap, seen: SeenView, arrived: tuple[str, ...]) -> Iterator[SeenView]:
        """This step's views in the order of the log, until the maps are as they were when the planner looked at them."""
        again = seen.view.seq == self._seq  # after a refused stair the robot's observation is the same
        self._seq = seen.view.seq
        state = self._decided_on.get(self._seq, MapsState(0, 0))
        self.n_pending = state.pending_views
        if not again:
            while self._camera_is_next():
                yield self._of_camera(*self._log.popleft())
            if self._log:
                self._log.popleft()
        yield seen
        while joint.revision < state.revision and self._camera_is_next():
            yield self._of_camera(*self._log.popleft())

    def _camera_is_next(self) -> bool:
        return bool(self._log) and self._log[0][0].startswith("camera/")

    def _of_camera(self, source: str, index: int) -> SeenView:
        views = self._sight.camera(source.removeprefix("camera/"))
        return next(seen for seen in views if seen.view.view == index)
