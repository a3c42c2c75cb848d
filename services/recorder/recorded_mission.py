"""A mission that is recorded, and from when to when."""

from __future__ import annotations

from dataclasses import dataclass, field

from surveilnav.messages import FINISHED_STATES, MissionStatus

#: How long recording goes on after the mission ended: its last observation and traffic reports are still under way.
_SETTLE_NS = 2 * 10**9


@dataclass(slots=True)
class LogPosition:
    """How far a recording has followed the log of a fusion service.

    Attributes:
        last_view: number of the newest view in the file; None: the file needs a snapshot of the maps first.
        removals: how many removals (``messages.RemoveFromMaps``) the maps in the file reflect.
    """

    last_view: int | None = None
    removals: int = 0


@dataclass(slots=True)
class RecordedMission:
    """A mission that is recorded.

    Attributes:
        id: the recording's id.
        status: the mission's newest status.
        logs: by fusion service, how far its log was followed.
        until_ns: when the file is closed; None: the mission goes on.
        has_prompt_embedding: the file holds the embedding of the mission's prompt.
    """

    id: str
    status: MissionStatus
    logs: dict[str, LogPosition] = field(default_factory=dict)
    until_ns: int | None = None
    has_prompt_embedding: bool = False

    def update(self, status: MissionStatus, now_ns: int) -> None:
        """Takes the planner's newest status; one that ends the mission sets when its file is closed."""
        self.status = status
        if status.state in FINISHED_STATES and self.until_ns is None:
            self.until_ns = now_ns + _SETTLE_NS

    def position_in(self, fusion: str) -> LogPosition:
        """How far the log of a fusion service was followed."""
        return self.logs.setdefault(fusion, LogPosition())

    def is_over(self, now_ns: int) -> bool:
        return self.until_ns is not None and now_ns >= self.until_ns


def is_under_way(status: MissionStatus) -> bool:
    """Whether a mission is to be recorded: it has a robot and hasn't ended."""
    return status.state not in (*FINISHED_STATES, "queued")
