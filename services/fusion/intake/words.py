"""The words that detectors with an open vocabulary look for: the targets of missions and searches, and a standing list."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from surveilnav.bus import Node
from surveilnav.contract import MISSION_STATUS
from surveilnav.errors import TargetError
from surveilnav.messages import FINISHED_STATES
from surveilnav.services.fusion.intake.camera_searches import CameraSearches
from surveilnav.words import MAX_WORDS, validate_word


class SearchedWords:
    """Follows the missions on the bus, and the searches with cameras, to know which words to look for."""

    def __init__(self, node: Node, standing: Sequence[str], searches: CameraSearches) -> None:
        """``standing``: words that are always looked for."""
        self._node, self._standing, self._searches = node, standing, searches
        node.alive("planner")  # the first call starts to follow presence
        self._missions = node.table(MISSION_STATUS)

    def current(self) -> tuple[str, ...]:
        """The words to look for now, sorted and unique: at most ``MAX_WORDS``, and those of missions take precedence.

        A mission counts only while a planner is on the bus to continue it.
        """
        searched = self.targets()
        words = list(dict.fromkeys((*sorted(searched), *sorted(_valid_words(self._standing)))))
        if len(words) > MAX_WORDS:
            self._node.warn_seldom("too many words are searched for at once", left_out=len(words) - MAX_WORDS)
        return tuple(sorted(words[:MAX_WORDS]))

    def targets(self) -> set[str]:
        """What missions and searches with cameras look for now, without the standing list."""
        return _valid_words(self._targets())

    @property
    def is_idle(self) -> bool:
        return not self._targets()

    def _targets(self) -> list[str]:
        rows = self._missions.rows() if self._node.alive("planner") else []
        missions = [row.message.target for row in rows if row.message.state not in FINISHED_STATES]
        return missions + self._searches.targets()


def _valid_words(names: Iterable[str]) -> set[str]:
    """Those of the names that are valid words. The planner refuses invalid ones, so these only come from bugs or attackers."""
    words = set()
    for name in names:
        try:
            words.add(validate_word(name))
        except TargetError:
            continue
    return words
