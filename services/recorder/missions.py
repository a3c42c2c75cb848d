"""Which missions are recorded, from when to when."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.messages import FINISHED_STATES, MissionStatus

#: After its mission ended: the last observation and the last traffic reports are still on their way.
_SETTLE_NS = 2 * 10**9


@dataclass(slots=True)
class Recorded:
    """A mission that is recorded. ``number``: of the newest view that its file holds; None: it needs the maps first.

    ``until_ns``: when its file is closed; None: the mission goes on. ``has_meaning``: its file holds what its target means.
    """

    id: str
    status: MissionStatus
    number: int | None = None
    until_ns: int | None = None
    has_meaning: bool = False

    def hear(self, status: MissionStatus, now_ns: int) -> None:
        """Takes in what the planner says of it."""
        self.status = status
        if status.state in FINISHED_STATES and self.until_ns is None:
            self.until_ns = now_ns + _SETTLE_NS

    def is_over(self, now_ns: int) -> bool:
        """Whether its file is to be closed."""
        return self.until_ns is not None and now_ns >= self.until_ns


def is_under_way(status: MissionStatus) -> bool:
    """Whether there is something to record: it has a robot and isn't over."""
    return status.state not in (*FINISHED_STATES, "queued")
