"""What a user, the network or the machine did wrong, as a line for people and as an object for programs."""

from __future__ import annotations

import errno
from typing import Any

from pydantic import ValidationError

from surveilnav.bus.main import explain


def in_words(error: Exception) -> str | None:
    """A line for each thing that is wrong; None: a bug, which wants its traceback."""
    if isinstance(error, ValidationError):
        return explain(error)
    if not isinstance(error, OSError):
        return f"error: {error}"
    full = error.errno in (errno.ENOSPC, errno.EDQUOT)
    if error.filename is None and not full:  # not about a file that the user named
        return None
    where = f"{error.filename}: " if error.filename else ""
    return f"error: {where}{error.strerror}{'; make room and run again' if full else ''}"


def as_object(error: Exception, words: str) -> dict[str, Any]:
    """What ``--json`` prints in place of an outcome: ``name`` is the contract's or the gateway's, where it has one."""
    name = getattr(error, "name", "")
    message = "\n".join(line.removeprefix("error: ") for line in words.splitlines())
    told = {"type": type(error).__name__, "message": message}
    return {"error": told | ({"name": name} if name else {})}
