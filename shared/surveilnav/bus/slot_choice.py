"""Which slot a process takes that has none, when several look for one at once."""

from __future__ import annotations

import zlib
from collections.abc import Collection, Sequence


def choose_slot(names: Sequence[str], taken: Collection[str], node_id: str) -> str | None:
    """A slot that nobody has taken, or None.

    Each node starts its search at a slot that depends on its id, so that replicas started together seldom collide.
    """
    if not names:
        return None
    start = zlib.crc32(node_id.encode()) % len(names)
    return next((name for name in (*names[start:], *names[:start]) if name not in taken), None)


def keeps_slot(node_id: str, rivals: Collection[str]) -> bool:
    """Whether a node keeps a slot that ``rivals`` claim, too: the smallest id does, the others choose again."""
    return all(node_id <= rival for rival in rivals)
