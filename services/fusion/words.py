"""What detectors with an open vocabulary look for: the targets of open missions, and a standing list."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from surveilnav.bus import Node
from surveilnav.contract import MISSION_STATUS
from surveilnav.errors import TargetError
from surveilnav.messages import FINISHED_STATES
from surveilnav.words import MAX_WORDS, checked_word


class Words:
    """Follows the missions."""

    def __init__(self, node: Node, standing: Sequence[str]) -> None:
        """``standing``: words that are always looked for."""
        self._standing = standing
        self._missions = node.table(MISSION_STATUS)

    def now(self) -> tuple[str, ...]:
        """The words of this moment, sorted, each once; at most ``MAX_WORDS``."""
        searched = (row.message.target for row in self._missions.rows() if row.message.state not in FINISHED_STATES)
        return tuple(sorted(_words([*self._standing, *searched][:MAX_WORDS])))


def _words(names: Iterable[str]) -> set[str]:
    """The names that are words; the planner refuses others, so what else comes is somebody's mischief."""
    words = set()
    for name in names:
        try:
            words.add(checked_word(name))
        except TargetError:
            continue
    return words
