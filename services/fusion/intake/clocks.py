"""Sources whose clocks are ahead: their times aren't believed."""

from __future__ import annotations

#: Clocks may be ahead by so much: what NTP leaves, and more.
MAX_AHEAD_NS = 1_000_000_000


class SourceClocks:
    """Corrects times of capture that lie in the future, which only a wrong clock can give.

    The correction is the largest lead that a source has shown, since its newest picture has it, and what was taken earlier stays
    earlier. Pictures from the past are left alone: they may be old.
    """

    def __init__(self) -> None:
        self._ahead_ns: dict[str, int] = {}

    def corrected_ns(self, source: str, stamp_ns: int, now_ns: int) -> int:
        """The time of capture [ns since 1970] by this machine's clock."""
        ahead_ns = stamp_ns - now_ns
        if ahead_ns <= MAX_AHEAD_NS:
            self._ahead_ns.pop(source, None)  # it was set right
            return stamp_ns
        known_ns = max(ahead_ns, self._ahead_ns.get(source, ahead_ns))
        self._ahead_ns[source] = known_ns
        return stamp_ns - known_ns
