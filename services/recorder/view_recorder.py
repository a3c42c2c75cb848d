"""Records every view that goes into fusion's maps, in fusion's order. If that isn't possible, the status says why."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import VIEW_LOG
from surveilnav.errors import BusError
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.fusion_client import FusionClient
from surveilnav.services.recorder.recorded_mission import RecordedMission
from surveilnav.services.recorder.writer import RecordingWriter

_RETRY_S = 2.0  # before fusion is asked again after an error
_MAX_VIEWS_PER_TURN = 32  # before the rest of the recorder's loop has its turn


class ViewRecorder:
    """Follows fusion's log of views. ``problem``: why no views are recorded; empty while all are. For one thread."""

    def __init__(self, node: Node, fusion: FusionClient, writer: RecordingWriter) -> None:
        self._node, self._fusion, self._writer = node, fusion, writer
        self.problem, self._retry_at_s = "", 0.0

    def catch_up(self, missions: Iterable[RecordedMission]) -> bool:
        """Brings the recordings up to fusion's newest view; returns whether there is more to record."""
        missions = list(missions)
        if not missions or time.monotonic() < self._retry_at_s:
            return False
        try:  # views first: if the maps for a new recording can't be had, the other recordings still get their views
            more, self.problem = self._record_views(missions), ""
            new = [m for m in missions if m.last_view is None]
            if new and not self._writer.is_attaching:
                self._record_maps(new)
                more = True
            return more
        except BusError as error:
            self.problem = f"views aren't recorded: {error}"
            self._retry_at_s = time.monotonic() + _RETRY_S
            self._node.warn_seldom("views aren't recorded", error=str(error))
            return False

    def finish(self, mission: RecordedMission) -> dict[str, str]:
        """Records the last views of a mission. Returns number, revision and digest of the maps that they make; nothing if some
        are missing."""
        try:
            maps = self._fusion.digest()
            if mission.last_view is not None and mission.removals != maps.removals:
                self._record_maps([mission])
            until_s = time.monotonic() + _RETRY_S
            while mission.last_view is not None and mission.last_view < maps.number and time.monotonic() < until_s:
                self._record_views([mission], maps.number)
            if mission.last_view == maps.number and mission.removals == maps.removals:
                return {"number": str(maps.number), "revision": str(maps.revision), "digest": maps.digest}
        except BusError as error:
            self._node.warn_seldom("a recording lacks the end of its maps", error=str(error))
        return {}

    def _record_maps(self, missions: Sequence[RecordedMission]) -> None:
        """Records a snapshot of the maps, one for all missions; their views continue after it."""
        header, data = self._fusion.snapshot()
        facts = {"config": header.config, "digest": header.digest}
        self._writer.attach([m.id for m in missions], f"maps-{header.number}", data, facts)
        for mission in missions:
            mission.last_view, mission.removals = header.number, header.removals

    def _record_views(self, missions: list[RecordedMission], up_to: int | None = None) -> bool:
        """Records a few more views, at most up to number ``up_to``; returns whether there may be others."""
        for _ in range(_MAX_VIEWS_PER_TURN):
            behind = [m for m in missions if m.last_view is not None and m.last_view != up_to]
            if not behind or not self._writer.has_room:
                return False
            after = min(m.last_view for m in behind if m.last_view is not None)
            received = self._fusion.next_view(after)
            view = received.message
            outdated = [m for m in behind if m.removals != view.removals]
            if outdated:  # a source was taken out of the maps: its views in the file don't give them any more
                self._restart_from_maps(outdated)
                return True
            next_ones = [m for m in behind if m.last_view == after]
            if view.number == 0:
                if view.newest < after:  # fusion began a new log
                    self._restart_from_maps(behind)
                return False
            if view.number > after + 1:  # the recorder was away for too long, or fusion's log is damaged
                self._restart_from_maps(next_ones)
                continue
            message = BusMessage(VIEW_LOG, received.key, view, received.payload, clock_ns())
            if not self._writer.record([m.id for m in next_ones], message):
                return False
            for mission in next_ones:
                mission.last_view = view.number
        return True

    def _restart_from_maps(self, missions: Iterable[RecordedMission]) -> None:
        """Has recordings whose views don't give the maps go on from a new snapshot of these."""
        for mission in missions:
            self._node.warn_seldom("a recording goes on from other maps", id=mission.id, after=mission.last_view)
            mission.last_view = None
