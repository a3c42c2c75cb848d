"""The conclusion that a rule of confirmation draws from the evidence on an object."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Status = Literal["candidate", "confirmed", "rejected"]


@dataclass(frozen=True, slots=True)
class Assessment:
    """An object's class, the confidence in it (0-1), its status, and the reason for that status in words for people."""

    label: str
    confidence: float
    status: Status
    reason: str
