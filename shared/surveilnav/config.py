"""Directories and other settings from the environment that are shared by all parts of the system."""

from __future__ import annotations

import os
from pathlib import Path

from surveilnav.errors import ConfigError
from surveilnav.storage import FolderCache


def cache_dir() -> Path:
    """The directory for data that can be made or downloaded again: SURVEILNAV_CACHE_DIR, else ``~/.cache/surveilnav``.

    It is created if it doesn't exist.

    Raises:
        ConfigError: it can't be created or isn't a directory.
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


def open_disk_cache(name: str, kind: bytes, max_mb: int) -> FolderCache | None:
    """The cache in the folder ``name`` of ``cache_dir()``; None if ``max_mb`` is 0, or the folder can't be created.

    ``kind``: format of its files; see ``storage.write_parts``.
    """
    if not max_mb:
        return None
    try:
        return FolderCache(cache_dir() / name, kind, ".kept", max_mb * 1_000_000)
    except ConfigError:
        return None


def models_dir() -> Path | None:
    """The directory with models, SURVEILNAV_MODELS_DIR; None if that isn't set.

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


def offline() -> bool:
    """Whether downloads are forbidden: SURVEILNAV_OFFLINE or HF_HUB_OFFLINE is set, and isn't 0, false, no or off."""
    values = (os.environ.get(name, "").strip().lower() for name in ("SURVEILNAV_OFFLINE", "HF_HUB_OFFLINE"))
    return any(value not in ("", "0", "false", "no", "off") for value in values)


def hub_endpoint() -> str:
    """The address of the Hugging Face hub or of a mirror: HF_ENDPOINT, by default the hub's own."""
    return os.environ.get("HF_ENDPOINT", "").strip().rstrip("/") or "https://huggingface.co"


def path_from_env(variable: str) -> Path | None:
    """The path in an environment variable; None if that isn't set."""
    value = os.environ.get(variable, "").strip()
    return Path(value).expanduser() if value else None
