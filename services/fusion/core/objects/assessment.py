"""What the evidence on an object comes to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Status = Literal["candidate", "confirmed", "rejected"]


@dataclass(frozen=True, slots=True)
class Assessment:
    """An object's class, the confidence 0-1 in it, and its status; ``reason`` is for people."""

    label: str
    confidence: float
    status: Status
    reason: str
