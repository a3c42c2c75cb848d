"""The states of a mission, said once for the contract's messages and for clients, which need no messages."""

from __future__ import annotations

from typing import Literal

MissionStateName = Literal["queued", "active", "confirming", "paused", "done", "failed", "cancelled"]
#: States that a mission never leaves.
FINISHED_STATES: tuple[MissionStateName, ...] = ("done", "failed", "cancelled")
