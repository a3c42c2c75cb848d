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

    DONE = 0, "it succeeded: the target was found, everything was read or played"
    FAILED = (
        1,
        "it didn't succeed; or a setting, a file or the system is wrong, and one line says what; or its output was closed",
    )
    MISTYPED = 2, "the command was mistyped: there is no such command or option"
    INTERRUPTED = (
        130,
        "interrupted by Ctrl-C; `up`, `watch`, `replay` and the page of `cameras calibrate` are meant to be "
        "ended so, and return 0",
    )
    TERMINATED = 143, "ended by SIGTERM; `up` and `replay` are meant to be ended so, and return 0"
