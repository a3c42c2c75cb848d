"""Places that the robot failed to reach, and frontiers that looking didn't explore; and how long it leaves each alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from surveilnav.services.planner.core.config import PlannerConfig

#: After this many failures a place stays blacklisted for the rest of the mission.
PERMANENT_AFTER = 2
#: The same for a place with a confirmed target, which deserves more attempts.
PERMANENT_AFTER_CONFIRMED = 4


@dataclass(frozen=True, slots=True)
class BlacklistEntry:
    """A place (x, y) [m, world] that the robot failed to reach ``failures`` times; it is left alone until ``until_step``."""

    x_m: float
    y_m: float
    failures: int
    until_step: int


@dataclass(slots=True)
class Blacklist:
    """The blacklisted places of one floor: frontiers and objects. Places within ``same_place_m`` count as one.

    A place is blacklisted for ``blacklist_steps`` steps at a time, and permanently once it failed often enough.
    """

    entries: list[BlacklistEntry] = field(default_factory=list)

    def contains(self, x_m: float, y_m: float, step: int, config: PlannerConfig, *, confirmed: bool = False) -> bool:
        """Whether a place is blacklisted at mission step ``step``, temporarily or permanently.

        ``confirmed``: a confirmed target is there, so more failures are allowed before it is permanent.
        """
        limit = _failures_allowed(confirmed=confirmed)
        return any(e.until_step > step or e.failures >= limit for e in self._near(x_m, y_m, config))

    def contains_permanently(self, x_m: float, y_m: float, config: PlannerConfig, *, confirmed: bool) -> bool:
        """Whether a place is blacklisted for the rest of the mission."""
        limit = _failures_allowed(confirmed=confirmed)
        return any(e.failures >= limit for e in self._near(x_m, y_m, config))

    def failures_at(self, x_m: float, y_m: float, config: PlannerConfig) -> int:
        return next((e.failures for e in self._near(x_m, y_m, config)), 0)

    def add(self, x_m: float, y_m: float, step: int, config: PlannerConfig, *, failures: int | None = None) -> None:
        """Blacklists a place from mission step ``step`` on.

        ``failures``: what its number of failures is set to; None counts one more failure.
        """
        until = step + config.blacklist_steps
        for i, e in enumerate(self.entries):
            if _is_near(e, x_m, y_m, config):
                failures = e.failures + 1 if failures is None else failures
                self.entries[i] = replace(e, failures=failures, until_step=until)
                return
        self.entries.append(BlacklistEntry(x_m, y_m, failures or 1, until))

    def release(self, x_m: float, y_m: float, step: int, config: PlannerConfig) -> None:
        """Ends the waiting time of a place; its failures stay counted."""
        self.entries = [_released(e, step) if _is_near(e, x_m, y_m, config) else e for e in self.entries]

    def is_waiting(self, step: int) -> bool:
        """Whether some place is left alone only for a while."""
        return any(e.until_step > step for e in self.entries)

    def copy(self) -> Blacklist:
        """A copy whose list is its own."""
        return Blacklist(list(self.entries))

    def _near(self, x_m: float, y_m: float, config: PlannerConfig) -> list[BlacklistEntry]:
        return [e for e in self.entries if _is_near(e, x_m, y_m, config)]


def _failures_allowed(*, confirmed: bool) -> int:
    return PERMANENT_AFTER_CONFIRMED if confirmed else PERMANENT_AFTER


def _released(entry: BlacklistEntry, step: int) -> BlacklistEntry:
    return replace(entry, until_step=min(entry.until_step, step))


def _is_near(entry: BlacklistEntry, x_m: float, y_m: float, config: PlannerConfig) -> bool:
    return math.hypot(entry.x_m - x_m, entry.y_m - y_m) < config.same_place_m
