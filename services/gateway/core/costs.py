"""What missions cost: the bytes that cameras and robots sent while each ran, and how many more there may be.

Nobody can tell which of two missions at one time a picture was for: each then has the sum, and says that it wasn't alone.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from surveilnav.messages import FINISHED_STATES, MissionStatus
from surveilnav.services.gateway.core.traffic import Traffic

_MOST_MISSIONS = 1000
#: Of so many of the newest steps the forecast takes the mean: the first, when cameras are invoked, cost much more.
_RECENT_STEPS = 20


@dataclass(frozen=True, slots=True)
class Sums:
    """The three numbers of all cameras and robots, without the pictures for people; ``wire`` 0 where no kernel tells."""

    offered: int = 0
    delivered: int = 0
    wire: int = 0

    @classmethod
    def of(cls, traffic: Traffic) -> Sums:
        """The sums of a table of traffic."""
        sources = [*traffic.cameras, *traffic.robots]
        viewers = sum(s.viewer_bytes for s in sources)
        wire = sum(s.wire_sent_bytes or 0 for s in sources)
        delivered = sum(s.delivered_bytes for s in sources)
        return cls(sum(s.offered_bytes for s in sources) - viewers, max(0, delivered - viewers), max(0, wire - viewers))

    def since(self, before: Sums) -> Sums:
        """What came after ``before``; who was started anew counts from 0, which isn't less than nothing."""
        return Sums(
            max(0, self.offered - before.offered),
            max(0, self.delivered - before.delivered),
            max(0, self.wire - before.wire),
        )

    def __add__(self, other: Sums) -> Sums:
        return Sums(self.offered + other.offered, self.delivered + other.delivered, self.wire + other.wire)


@dataclass(slots=True)
class Cost:
    """Of one mission. ``whole``: counted from its first step; ``alone``: no other ran meanwhile."""

    mission: str
    whole: bool
    spent: Sums = field(default_factory=Sums)
    alone: bool = True
    recent: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_RECENT_STEPS + 1))

    def add(self, sums: Sums, step: int, *, alone: bool) -> None:
        """Counts what came since the last time."""
        self.spent += sums
        self.alone = self.alone and alone
        if not self.recent or self.recent[-1][0] < step:
            self.recent.append((step, self.spent.offered))

    @property
    def per_step(self) -> float | None:
        """Bytes offered a step, of the newest steps; None before there were enough of them: what cameras send at first would
        be taken for what they go on sending."""
        if len(self.recent) <= _RECENT_STEPS:
            return None
        (first, before), (last, now) = self.recent[0], self.recent[-1]
        return (now - before) / (last - first)

    def at_most(self, status: MissionStatus) -> float | None:
        """Bytes offered in the end if it goes on like this and uses all its steps; None: nobody can say."""
        per_step = self.per_step
        if per_step is None or not status.max_steps or status.state in FINISHED_STATES:
            return None
        return self.spent.offered + per_step * max(0, status.max_steps - status.step)


class Costs:
    """Of the newest missions. Not safe for several threads."""

    def __init__(self) -> None:
        self._costs: OrderedDict[str, Cost] = OrderedDict()
        self._last: Sums | None = None

    def look(self, statuses: Iterable[MissionStatus], sums: Sums) -> None:
        """Takes in what was sent since the last look, for the missions that run."""
        new = sums.since(self._last) if self._last is not None else Sums()
        self._last = sums
        running = [s for s in statuses if s.state not in FINISHED_STATES and s.state != "queued"]
        for status in running:
            if status.mission not in self._costs:
                self._costs[status.mission] = Cost(status.mission, whole=status.step <= 1)
            self._costs[status.mission].add(new, status.step, alone=len(running) == 1)
        while len(self._costs) > _MOST_MISSIONS:
            self._costs.popitem(last=False)

    def get(self, mission: str) -> Cost | None:
        """What a mission has cost so far; None: it wasn't seen running."""
        return self._costs.get(mission)
