"""Reads the parameters of queries."""

from __future__ import annotations

from surveilnav.bus import Request


def number_of(request: Request, name: str) -> int | None:
    """A parameter that is a non-negative number; None if it is missing or anything else."""
    text = request.parameters.get(name, "")
    return int(text) if text.isascii() and text.isdigit() and len(text) <= 16 else None
