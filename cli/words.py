"""Numbers and times as people read them."""

from __future__ import annotations

from datetime import datetime


def human_bytes(n: int | None) -> str:
    """Decimal units, two or three figures: "312 B", "4.7 kB", "81 MB"."""
    if n is None:
        return "–"
    value, unit = float(n), "B"
    for unit in ("B", "kB", "MB", "GB", "TB"):
        if value < 999.5 or unit == "TB":
            break
        value /= 1000
    return f"{value:.1f} {unit}" if value < 9.95 and unit != "B" else f"{value:.0f} {unit}"


def metres(value: float | None) -> str:
    """ "12.3 m"; nothing where nobody knows."""
    return "" if value is None else f"{value:.1f} m"


def duration(seconds: float | None) -> str:
    """ "8 s", "3 min 20 s", "2 h 5 min"; nothing where nobody knows."""
    if seconds is None or seconds < 0:
        return ""
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"


def why_perceived(why: str, calibrated: bool) -> str:
    """Why a backend was chosen, and whether its chances are only scores."""
    return why if calibrated else f"{why}; uncalibrated: scores stand in for chances"


def clock(when: datetime | None) -> str:
    """A time of the gateway by this machine's clock: "14:03:22"; nothing if there is none."""
    return f"{when.astimezone():%H:%M:%S}" if when else ""
