"""What people read in a terminal: results on standard output, all else on standard error."""

from __future__ import annotations

import re
from typing import Any

from rich.console import Console

#: What a terminal obeys instead of showing it. Names in other people's files may hold any of it.
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def plain(text: str) -> str:
    """The text without what a terminal would obey: escape codes, changes of direction."""
    return _CONTROL.sub("\N{REPLACEMENT CHARACTER}", text)


class Terminal(Console):
    """A console that shows what it is given and obeys none of it."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As ``Console.print``; texts are made plain first."""
        super().print(*(plain(o) if isinstance(o, str) else o for o in objects), **options)
