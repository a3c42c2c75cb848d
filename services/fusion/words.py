"""What detectors with an open vocabulary look for: the targets of open missions, and a standing list."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from surveilnav.bus import Node
from surveilnav.contract import MISSION_STATUS
from surveilnav.errors import TargetError
from surveilnav.messages import FINISHED_STATES
from surveilnav.words import MAX_WORDS, validate_word


class Words:
    """Follows the missions."""

    def __init__(self, node: Node, standing: Sequence[str]) -> None:
        """``standing``: words that are always looked for."""
        self._node, self._standing = node, standing
        node.alive("planner")  # the first call starts watching
        self._missions = node.table(MISSION_STATUS)

    def now(self) -> tuple[str, ...]:
        """The words of this moment, sorted, each once; at most ``MAX_WORDS``, missions' first. Without a planner on the bus no
        mission goes on."""
        searched = _words(self._targets())
        words = list(dict.fromkeys((*sorted(searched), *sorted(_words(self._standing)))))
        if len(words) > MAX_WORDS:
            self._node.warn_seldom("too many words are searched for at once", left_out=len(words) - MAX_WORDS)
        return tuple(sorted(words[:MAX_WORDS]))

    def idle(self) -> bool:
        """Whether nobody searches."""
        return not self._targets()

    def _targets(self) -> list[str]:
        """Of the missions that go on."""
        told = self._missions.rows() if self._node.alive("planner") else []
        return [row.message.target for row in told if row.message.state not in FINISHED_STATES]


def _words(names: Iterable[str]) -> set[str]:
    """The names that are words; the planner refuses others, so what else comes is somebody's mischief."""
    words = set()
    for name in names:
        try:
            words.add(validate_word(name))
        except TargetError:
            continue
    return words
