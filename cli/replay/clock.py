"""Which moment of a recording is told now: it plays, stands still, or jumps. Times are given, so nothing here waits."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(slots=True)
class ReplayClock:
    """A moment of a recording of ``duration_s`` that goes on ``speed`` times as fast as time does, while it plays.

    ``now_s`` in the methods is any clock that only goes forward.
    """

    duration_s: float
    speed: float = 1.0
    playing: bool = True
    _at_s: float = 0.0  # the moment ...
    _since_s: float | None = None  # ... at this time; None: not begun

    def at_s(self, now_s: float) -> float:
        """The moment, between 0 and ``duration_s``."""
        if not self.playing or self._since_s is None:
            return self._at_s
        return min(self.duration_s, self._at_s + self.speed * (now_s - self._since_s))

    def set(
        self, now_s: float, *, at_s: float | None = None, speed: float | None = None, playing: bool | None = None
    ) -> None:
        """Changes what is given. At its end it stands still, also when it is taken elsewhere from there. Told to play
        while at its end, it plays from its beginning."""
        ended = self.ended(now_s)
        at = self.at_s(now_s) if at_s is None else min(max(at_s, 0.0), self.duration_s)
        if playing and ended and at_s is None:
            at = 0.0
        self._at_s, self._since_s = at, now_s
        self.speed = self.speed if speed is None else speed
        self.playing = (self.playing and not ended) if playing is None else playing

    def ended(self, now_s: float) -> bool:
        return self.at_s(now_s) >= self.duration_s

    def wait_s(self, moment_s: float, now_s: float) -> float:
        """How long it takes until a moment has come: 0 if it has, infinity while it stands still."""
        left = moment_s - self.at_s(now_s)
        if left <= 0:
            return 0.0
        return left / self.speed if self.playing else float("inf")
