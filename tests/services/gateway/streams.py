"""Server-Sent Events as tests read them: whole ones, out of a stream that may be cut off."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import NamedTuple


class ReceivedEvent(NamedTuple):
    id: str
    kind: str
    data: dict


def blocks(chunks: Iterator[str]) -> Iterator[ReceivedEvent]:
    """The whole events of a stream: what a cut leaves unfinished isn't one."""
    text = ""
    for chunk in chunks:
        text += chunk
        while "\n\n" in text:
            block, text = text.split("\n\n", 1)
            fields = dict(line.split(": ", 1) for line in block.split("\n"))
            if "event" in fields:
                yield ReceivedEvent(fields["id"], fields["event"], json.loads(fields["data"]))


def within(budget: int, chunks: Iterator[str]) -> Iterator[str]:
    """The first ``budget`` characters."""
    for chunk in chunks:
        yield chunk[:budget]
        budget -= len(chunk)
        if budget <= 0:
            return
