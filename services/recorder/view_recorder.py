"""Records every view that goes into the maps, in fusion's order. If that isn't possible, the status says why."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence

from surveilnav.bus import Node, clock_ns
from surveilnav.contract import VIEW_LOG
from surveilnav.errors import BusError
from surveilnav.messages.recording import ONLY_FUSION
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.facts import fact_name
from surveilnav.services.recorder.fusion_client import FusionClient
from surveilnav.services.recorder.recorded_mission import LogPosition, RecordedMission
from surveilnav.services.recorder.writer import RecordingWriter

_RETRY_S = 2.0  # before fusion is asked again after an error
_MAX_VIEWS_PER_TURN = 32  # before the rest of the recorder's loop has its turn


class ViewRecorders:
    """Follows the logs of all fusion services. ``problem``: why views aren't recorded; empty while all are. For one thread."""

    def __init__(self, node: Node, writer: RecordingWriter) -> None:
        self._node, self._writer = node, writer
        self._recorders: dict[str, ViewRecorder] = {}

    @property
    def problem(self) -> str:
        return "; ".join(r.problem for r in list(self._recorders.values()) if r.problem)

    def catch_up(self, missions: Sequence[RecordedMission]) -> bool:
        """Brings the recordings up to the newest view of every fusion service; returns whether there is more to record."""
        begun = {fusion for mission in missions for fusion, at in mission.logs.items() if at.last_view is not None}
        followed = self._node.alive("fusion") | begun
        for fusion in followed or {ONLY_FUSION}:
            if fusion not in self._recorders:
                self._recorders[fusion] = ViewRecorder(self._node, fusion, self._writer)
        for fusion in set(self._recorders) - followed if followed else ():
            del self._recorders[fusion]
        more = [recorder.catch_up(missions) for _, recorder in sorted(self._recorders.items())]
        return any(more)

    def finish(self, mission: RecordedMission) -> dict[str, str]:
        """Records the last views of a mission. Returns what the maps come to that they make, by ``fact_name``."""
        facts: dict[str, str] = {}
        for fusion, recorder in self._recorders.items():
            facts |= {fact_name(name, fusion): said for name, said in recorder.finish(mission).items()}
        return facts


class ViewRecorder:
    """Follows the log of one fusion service. ``problem``: why no views are recorded; empty while all are."""

    def __init__(self, node: Node, fusion: str, writer: RecordingWriter) -> None:
        self._node, self._name, self._writer = node, fusion, writer
        self._fusion = FusionClient(node, fusion)
        self.problem, self._retry_at_s = "", 0.0

    def catch_up(self, missions: Sequence[RecordedMission]) -> bool:
        """Brings the recordings up to fusion's newest view; returns whether there is more to record."""
        if not missions or time.monotonic() < self._retry_at_s:
            return False
        try:  # views first: if the maps for a new recording can't be had, the other recordings still get their views
            more, self.problem = self._record_views(missions), ""
            new = [m for m in missions if self._at(m).last_view is None]
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
        at = self._at(mission)
        try:
            maps = self._fusion.digest()
            if at.last_view is not None and at.removals != maps.removals:
                self._record_maps([mission])
            until_s = time.monotonic() + _RETRY_S
            while at.last_view is not None and at.last_view < maps.number and time.monotonic() < until_s:
                self._record_views([mission], maps.number)
            if at.last_view == maps.number and at.removals == maps.removals:
                return {"number": str(maps.number), "revision": str(maps.revision), "digest": maps.digest}
        except BusError as error:
            self._node.warn_seldom("a recording lacks the end of its maps", error=str(error))
        return {}

    def _at(self, mission: RecordedMission) -> LogPosition:
        return mission.position_in(self._name)

    def _record_maps(self, missions: Sequence[RecordedMission]) -> None:
        """Records a snapshot of the maps, one for all missions; their views continue after it."""
        header, data = self._fusion.snapshot()
        facts = {"config": header.config, "digest": header.digest, "fusion": self._name}
        self._writer.attach([m.id for m in missions], f"maps-{self._name}-{header.number}", data, facts)
        for mission in missions:
            at = self._at(mission)
            at.last_view, at.removals = header.number, header.removals

    def _record_views(self, missions: Sequence[RecordedMission], up_to: int | None = None) -> bool:
        """Records a few more views, at most up to number ``up_to``; returns whether there may be others."""
        for _ in range(_MAX_VIEWS_PER_TURN):
            behind = [(m, at) for m in missions if (at := self._at(m)).last_view is not None and at.last_view != up_to]
            if not behind or not self._writer.has_room:
                return False
            after = min(at.last_view for _, at in behind if at.last_view is not None)
            received = self._fusion.next_view(after)
            view = received.message
            outdated = [at for _, at in behind if at.removals != view.removals]
            if outdated:  # a source was taken out of the maps: its views in the file don't give them any more
                self._restart_from_maps(outdated)
                return True
            next_ones = [(m, at) for m, at in behind if at.last_view == after]
            if view.number == 0:
                if view.newest < after:  # fusion began a new log
                    self._restart_from_maps([at for _, at in behind])
                return False
            if view.number > after + 1:  # the recorder was away for too long, or fusion's log is damaged
                self._restart_from_maps([at for _, at in next_ones])
                continue
            message = BusMessage(VIEW_LOG, received.key, view, received.payload, clock_ns())
            if not self._writer.record([m.id for m, _ in next_ones], message):
                return False
            for _, at in next_ones:
                at.last_view = view.number
        return True

    def _restart_from_maps(self, positions: Iterable[LogPosition]) -> None:
        """Has recordings whose views don't give the maps go on from a new snapshot of these."""
        for at in positions:
            self._node.warn_seldom("a recording goes on from other maps", fusion=self._name, after=at.last_view)
            at.last_view = None
