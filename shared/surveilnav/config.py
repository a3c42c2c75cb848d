"""Where things lie on this machine: the two directories that everything else is found under."""

from __future__ import annotations

import os
from pathlib import Path

from surveilnav.errors import ConfigError


def cache_dir() -> Path:
    """The directory for what can be made or downloaded again: SURVEILNAV_CACHE_DIR, else ``~/.cache/surveilnav``.

    It is made if it doesn't exist.

    Raises:
        ConfigError: it can't be made or isn't a directory.
    """
    value = os.environ.get("SURVEILNAV_CACHE_DIR", "").strip()
    base = os.environ.get("XDG_CACHE_HOME", "").strip()
    if value:
        path = Path(value).expanduser()
    else:
        path = (Path(base) if base else Path("~/.cache").expanduser()) / "surveilnav"
    try:
        path.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError) as error:
        raise ConfigError(
            f"the cache directory {path} can't be made ({error}); set SURVEILNAV_CACHE_DIR to a directory you can write"
        ) from error
    return path


def models_dir() -> Path | None:
    """The directory with detector weights: SURVEILNAV_MODELS_DIR, or None if it isn't set.

    Raises:
        ConfigError: it is set but isn't a directory.
    """
    value = os.environ.get("SURVEILNAV_MODELS_DIR", "").strip()
    if not value:
        return None
    path = Path(value).expanduser()
    if not path.is_dir():
        raise ConfigError(f"SURVEILNAV_MODELS_DIR must name a directory with detector weights, got {value!r}")
    return path
