"""What a user, the network or the machine did wrong, as a line for people and as an object for programs."""

from __future__ import annotations

import errno
from typing import Any

from surveilnav.errors import SurveilNavError, explain_settings_error


def in_words(error: Exception) -> str | None:
    """A line for each thing that is wrong; None: a bug, which wants its traceback."""
    if isinstance(error, SurveilNavError):
        return f"error: {error}"
    if (words := _of_settings(error)) is not None:
        return words
    if not isinstance(error, OSError):
        return None
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    if error.filename is None and not full:  # not about a file that the user named
        return None
    where = f"{error.filename}: " if error.filename else ""
    return f"error: {where}{error.strerror}{'; make room and run again' if full else ''}"


def _of_settings(error: Exception) -> str | None:
    """What is wrong with the settings in the environment; None: it is another error, or nothing here reads settings."""
    try:
        from pydantic import ValidationError
        from pydantic_settings import SettingsError
    except ModuleNotFoundError:  # a base installation
        return None
    if isinstance(error, ValidationError):
        return explain_settings_error(error)
    return f"error: {error}" if isinstance(error, SettingsError) else None


def usage_of(error: Exception) -> str | None:
    """What is wrong with the command as it was typed, if that is what the parser says; None: another error.

    Typer shows its parser's errors by itself and names only some of their classes, so they are known by what they can do.
    """
    format_message = getattr(error, "format_message", None)
    return str(format_message()) if callable(format_message) else None


def as_object(error: Exception, words: str) -> dict[str, Any]:
    """What ``--json`` prints in place of an outcome: ``name`` is the contract's or the gateway's, where it has one."""
    name = getattr(error, "name", "")
    message = "\n".join(line.removeprefix("error: ") for line in words.splitlines())
    told = {"type": type(error).__name__, "message": message}
    return {"error": told | ({"name": name} if name else {})}
