"""Which objects are wanted, and in which order."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from surveilnav.messages import ObjectRecord
from surveilnav.nouns import thing_asked_for
from surveilnav.words import canonical


@dataclass(frozen=True, slots=True)
class ObjectFilter:
    """What an object must be: None and 0 leave it open. ``label`` is taken in any spelling or language."""

    floor: str | None = None
    label: str | None = None
    status: str | None = None
    min_confidence: float = 0.0

    def chosen(self, records: Iterable[ObjectRecord]) -> list[ObjectRecord]:
        """Those wanted, that fit the text asked for first (best first), then by floor, last seen first."""
        found = [r for r in records if self._wants(r)]
        found.sort(key=lambda r: (r.floor, -r.last_seen_ns, r.id))
        return sorted(found, key=lambda r: (r.relevance is None, -(r.relevance or 0.0)))

    def _wants(self, record: ObjectRecord) -> bool:
        return (
            (self.floor is None or record.floor == self.floor)
            and (self.label is None or record.label in {canonical(self.label), thing_asked_for(self.label)})
            and (self.status is None or record.status == self.status)
            # what isn't a number is no confidence
            and (not self.min_confidence or record.confidence >= self.min_confidence)
        )
