from __future__ import annotations

import msgspec

from surveilnav.perception.vocabulary import COCO
from surveilnav.services.camera_node.core.summary import (
    ViewLabels,
    build_summary,
    merge_labels,
    next_view_to_examine,
    summary_due,
)


def test_a_summary_is_small_and_keeps_the_surest() -> None:
    labels = {label: (k + 1) / 100 for k, label in enumerate(COCO)}
    message = build_summary("c0-1", "0", labels, stamp_ns=2**62)
    size = len(msgspec.msgpack.encode(message))
    assert 450 < size <= 512
    kept = sorted(message.labels.values())
    assert kept == sorted(labels.values())[-len(kept) :]
    assert build_summary("c0-1", "0", {"bed": 0.123456}, stamp_ns=1).labels == {"bed": 0.123}
    assert build_summary("c0-1", "0", {}, stamp_ns=1).labels == {}
    assert build_summary("c0-1", "0", {"x" * 600: 1.0}, stamp_ns=1).labels == {}


def test_every_view_is_looked_at_once_and_again_when_it_changed() -> None:
    seen: dict[int, ViewLabels] = {}
    versions = {0: 0, 1: 0, 2: 0}
    order = []
    while (view := next_view_to_examine(seen, versions)) is not None:
        order.append(view)
        seen[view] = ViewLabels(versions[view], {})
    assert order == [0, 1, 2]
    assert next_view_to_examine(seen, {0: 0, 1: 1, 2: 5}) == 2, "the one that is longest out of date"
    assert next_view_to_examine(seen, {0: 1, 1: 0, 2: 0, 7: 0}) == 7, "one never looked at before one that changed"


def test_labels_are_the_highest_of_all_views() -> None:
    seen = {0: ViewLabels(0, {"tv": 0.4, "bed": 0.9}), 1: ViewLabels(0, {"tv": 0.6}), 2: ViewLabels(0, {})}
    assert merge_labels(seen) == {"tv": 0.6, "bed": 0.9}
    assert merge_labels({**seen, 1: ViewLabels(1, {})}) == {"tv": 0.4, "bed": 0.9}, (
        "a view that changed forgets what it showed"
    )


def test_news_comes_sooner_than_the_rate_but_not_at_once() -> None:
    assert summary_due(float("inf"), news=True, period_s=5.0)
    assert summary_due(5.0, news=False, period_s=5.0)
    assert not summary_due(4.9, news=False, period_s=5.0)
    assert summary_due(2.0, news=True, period_s=5.0)
    assert not summary_due(1.9, news=True, period_s=5.0)
