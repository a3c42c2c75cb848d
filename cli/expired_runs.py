"""Removes folders of earlier searches, which hold pictures, if SURVEILNAV_PICTURES__KEEP_H sets an age for pictures."""

from __future__ import annotations

import re
import shutil
from datetime import UTC, datetime, timedelta
from pathlib import Path

#: As ``run_demo`` names them; nothing else is ever touched.
_NAME = re.compile(r"(\d{8}-\d{6})-[0-9a-f]{4}")


def remove_expired_runs(runs: Path, keep_s: float | None, now: datetime | None = None) -> int:
    """Removes runs that began longer ago than ``keep_s`` (None: none); how many. What can't be removed stays."""
    if keep_s is None or not runs.is_dir():
        return 0
    oldest = (now or datetime.now(UTC)) - timedelta(seconds=keep_s)
    removed = 0
    for folder in runs.iterdir():
        began = _began(folder.name)
        if began is not None and began < oldest and folder.is_dir() and not folder.is_symlink():
            shutil.rmtree(folder, ignore_errors=True)
            removed += not folder.exists()
    return removed


def _began(name: str) -> datetime | None:
    match = _NAME.fullmatch(name)
    try:
        return datetime.strptime(match[1], "%Y%m%d-%H%M%S").replace(tzinfo=UTC) if match else None
    except ValueError:
        return None
