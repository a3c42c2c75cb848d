"""What the command's exit status says."""

from __future__ import annotations

from enum import IntEnum


class Exit(IntEnum):
    """Every status that ``surveilnav`` ends with; ``about`` is the line of the documentation."""

    about: str

    def __new__(cls, code: int, about: str) -> Exit:
        member = int.__new__(cls, code)
        member._value_ = code
        member.about = about
        return member

    DONE = 0, "it is done: found and right, all read, all played"
    FAILED = (
        1,
        "it isn't; or a setting, a file or the system is wrong, as one line says; or nobody reads its output",
    )
    MISTYPED = 2, "the command can't be as it was typed"
    INTERRUPTED = 130, "interrupted by Ctrl-C; `up`, `watch` and `replay` end by it, and with 0"
    TERMINATED = 143, "ended by SIGTERM; `up` and `replay` end by it, and with 0"
