"""Processes that are kept running."""

from __future__ import annotations

from pydantic import Field

from surveilnav.messages import ServiceState
from surveilnav.services.gateway.core.resources.base import Resource, Text, Time


class Service(Resource):
    id: str = Field(validation_alias="name")
    running: bool = Field(description="false: it ended; its next start is waited for, or it was given up")
    restarts: int = Field(description="how often it was started again")
    restarted: Time = Field(validation_alias="restarted_ns", description="when that was last")
    why: Text = Field(description="how it had ended: a signal or an exit code")
    given_up: bool = Field(description="it ended too often in a row, and isn't started any more")

    @classmethod
    def from_state(cls, state: ServiceState, seen_ns: int, stale: bool) -> Service:
        """A process as who keeps it running tells of it."""
        return cls.made_of(state, last_seen=seen_ns, stale=stale)
