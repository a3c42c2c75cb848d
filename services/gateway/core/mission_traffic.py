"""What missions cost: the bytes that cameras and robots sent while each ran, and a forecast.

Nobody can tell which of two missions at the same time a picture was for. Each then gets the sum, and says that it wasn't alone.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from surveilnav.messages import FINISHED_STATES, MissionStatus
from surveilnav.rest import LinkTraffic, MissionTraffic, Traffic
from surveilnav.services.gateway.core.resources import utc
from surveilnav.services.gateway.core.traffic_series import LINKS

_MAX_MISSIONS = 1000
#: The forecast takes the mean of so many of the newest steps: the first, when cameras are invoked, cost much more.
_RECENT_STEPS = 20


@dataclass(frozen=True, slots=True)
class ByteCounts:
    """Bytes of all cameras and robots, without the pictures for people. ``wire`` is 0 where no kernel counts.

    ``links``: what all processes offered, by link, in the order of ``LINKS``.
    """

    offered: int = 0
    delivered: int = 0
    wire: int = 0
    links: tuple[int, ...] = (0,) * len(LINKS)

    @classmethod
    def from_traffic(cls, traffic: Traffic) -> ByteCounts:
        """The sums over the cameras and robots of a table of traffic."""
        sources = [*traffic.cameras, *traffic.robots]
        viewers = sum(s.viewer_bytes for s in sources)
        wire = sum(s.wire_sent_bytes or 0 for s in sources)
        delivered = sum(s.delivered_bytes for s in sources)
        offered = sum(s.offered_bytes for s in sources)
        links = tuple(getattr(traffic.links, f"{link}_bytes") for link in LINKS)
        return cls(offered - viewers, max(0, delivered - viewers), max(0, wire - viewers), links)

    def since(self, before: ByteCounts) -> ByteCounts:
        """What came after ``before``. A process that was restarted counts from 0 again: that isn't less than nothing."""
        return ByteCounts(
            max(0, self.offered - before.offered),
            max(0, self.delivered - before.delivered),
            max(0, self.wire - before.wire),
            tuple(max(0, now - then) for now, then in zip(self.links, before.links, strict=True)),
        )

    def __add__(self, other: ByteCounts) -> ByteCounts:
        links = tuple(a + b for a, b in zip(self.links, other.links, strict=True))
        return ByteCounts(self.offered + other.offered, self.delivered + other.delivered, self.wire + other.wire, links)


@dataclass(slots=True)
class MissionUsage:
    """The bytes of one mission. ``whole``: counted from its first step; ``alone``: no other mission ran meanwhile."""

    mission: str
    whole: bool
    spent: ByteCounts = field(default_factory=ByteCounts)
    alone: bool = True
    recent: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_RECENT_STEPS + 1))

    def add(self, counts: ByteCounts, step: int, *, alone: bool) -> None:
        """Adds what came since the last time; the mission is at ``step`` now."""
        self.spent += counts
        self.alone = self.alone and alone
        if not self.recent or self.recent[-1][0] < step:
            self.recent.append((step, self.spent.offered))

    @property
    def per_step(self) -> float | None:
        """Bytes offered per step, mean of the newest steps. None before there are enough of them: what cameras send in the
        beginning would be taken for what they go on sending."""
        if len(self.recent) <= _RECENT_STEPS:
            return None
        (first, before), (last, now) = self.recent[0], self.recent[-1]
        return (now - before) / (last - first)

    def at_most(self, status: MissionStatus) -> float | None:
        """Bytes offered in the end if the coming steps cost as much and it uses all of them; None where that isn't known."""
        per_step = self.per_step
        if per_step is None or not status.max_steps or status.state in FINISHED_STATES:
            return None
        return self.spent.offered + per_step * max(0, status.max_steps - status.step)

    def resource(self, status: MissionStatus, seen_ns: int) -> MissionTraffic:
        """The same as a resource; ``status`` is the mission's newest, which arrived at ``seen_ns``."""
        return MissionTraffic(
            mission=self.mission,
            offered_bytes=self.spent.offered,
            delivered_bytes=self.spent.delivered,
            wire_sent_bytes=self.spent.wire,
            alone=self.alone,
            whole=self.whole,
            links=LinkTraffic(**{f"{link}_bytes": n for link, n in zip(LINKS, self.spent.links, strict=True)}),
            per_step_bytes=self.per_step,
            at_most_bytes=self.at_most(status),
            last_seen=utc(seen_ns),
            stale=False,
        )


class MissionUsages:
    """The usage of the newest missions. Not thread-safe."""

    def __init__(self) -> None:
        self._usages: OrderedDict[str, MissionUsage] = OrderedDict()
        self._last: ByteCounts | None = None

    def update(self, statuses: Iterable[MissionStatus], counts: ByteCounts) -> None:
        """Adds what was sent since the last update to the missions that run."""
        new = counts.since(self._last) if self._last is not None else ByteCounts()
        self._last = counts
        running = [s for s in statuses if s.state not in FINISHED_STATES and s.state != "queued"]
        for status in running:
            if status.mission not in self._usages:
                self._usages[status.mission] = MissionUsage(status.mission, whole=status.step <= 1)
            self._usages[status.mission].add(new, status.step, alone=len(running) == 1)
        while len(self._usages) > _MAX_MISSIONS:
            self._usages.popitem(last=False)

    def get(self, mission: str) -> MissionUsage | None:
        """The usage of a mission so far; None if it wasn't seen running."""
        return self._usages.get(mission)
