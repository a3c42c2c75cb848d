"""Which views to send now, and how large a thumbnail is."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

#: Thumbnails below this width show nothing useful.
_MIN_THUMBNAIL_PX = 64


@dataclass(frozen=True, slots=True)
class SendState:
    """What the listeners have already. ``sent``: by view, the version of its picture that was sent last."""

    sent: Mapping[int, int] = field(default_factory=dict)

    def without(self, views: Collection[int]) -> SendState:
        """The state if these views weren't sent after all."""
        return SendState({v: version for v, version in self.sent.items() if v not in views}) if views else self


def views_to_send(
    state: SendState,
    *,
    versions: Mapping[int, int],
    matched: Collection[int],
    requested: Collection[int] = (),
    paused: bool = False,
) -> tuple[SendState, tuple[int, ...]]:
    """Decides which views to send now: those with a listener that doesn't have the present version or asks for it again.

    Args:
        versions: by view, the version of its present picture; a new number means that the picture changed.
        matched: views whose publishers have a listener. Views without one are neither rendered nor encoded nor sent.
        requested: views that somebody asked to have again; they are sent only if they have a listener.
        paused: nothing is sent; when the pause ends every listener gets each view again.

    Returns:
        The next state, assuming that all these views are sent, and the views, requested ones first. A view that loses
        its last listener is dropped from the state, so that the next listener gets it at once.
    """
    if paused:
        return SendState(), ()
    listened = [v for v in sorted(versions) if v in matched]
    due = [v for v in listened if v in requested or state.sent.get(v) != versions[v]]
    sent = {v: versions[v] if v in due else state.sent[v] for v in listened}
    return SendState(sent), tuple(sorted(due, key=lambda v: (v not in requested, v)))


def thumbnail_width_px(requested_px: int, max_px: int) -> int:
    """The width of a thumbnail for a request; 0 asks for the largest that the settings allow."""
    return min(max(requested_px, _MIN_THUMBNAIL_PX), max_px) if requested_px else max_px
