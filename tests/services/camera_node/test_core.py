from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.perception.vocabulary import COCO
from surveilnav.services.camera_node.core import (
    SendState,
    ViewLabels,
    build_summary,
    choose_slot,
    keeps_slot,
    merge_labels,
    next_view_to_examine,
    summary_due,
    views_to_send,
)


def test_views_are_sent_once_while_somebody_listens() -> None:
    versions = {0: 1, 1: 1, 2: 1}
    state, send = views_to_send(SendState(), versions=versions, matched=[])
    assert send == (), "nobody listens"
    state, send = views_to_send(state, versions=versions, matched=[0, 2])
    assert send == (0, 2)
    state, send = views_to_send(state, versions=versions, matched=[0, 2])
    assert send == (), "nothing changed"
    state, send = views_to_send(state, versions={**versions, 1: 2, 2: 2}, matched=[0, 2])
    assert send == (2,), "view 1 changed too, but nobody listens to it"
    state, send = views_to_send(state, versions={**versions, 2: 2}, matched=[0, 1, 2], requested=[2])
    assert send == (2, 1), "what was asked for goes first"
    state, send = views_to_send(state, versions={**versions, 2: 2}, matched=[1, 2])
    assert send == ()
    state, send = views_to_send(state, versions={**versions, 2: 2}, matched=[0, 1, 2])
    assert send == (0,), "a new listener of view 0 has nothing yet"


@pytest.mark.parametrize("requested", [[0], [7], [0, 7, -1]])
def test_a_request_without_a_listener_sends_nothing(requested) -> None:
    assert views_to_send(SendState(), versions={0: 1}, matched=[], requested=requested)[1] == ()
    assert 7 not in views_to_send(SendState(), versions={0: 1}, matched=[0, 7], requested=requested)[1]


@given(st.sets(st.integers(0, 9)), st.integers(0, 10), st.text(min_size=1, max_size=8))
def test_a_slot_is_free_and_exists(claimed, total, node) -> None:
    slot = choose_slot(claimed, total, node)
    if slot is None:
        assert set(range(total)) <= claimed
    else:
        assert slot in set(range(total)) - claimed
        assert slot == choose_slot(claimed, total, node)


def test_replicas_begin_at_different_slots_and_one_of_two_rivals_yields() -> None:
    assert len({choose_slot(set(), 8, f"node-{k}") for k in range(20)}) > 4
    assert keeps_slot("a", ["b", "c"])
    assert not keeps_slot("b", ["a"])
    assert keeps_slot("a", [])
    assert sum(keeps_slot(me, [n for n in "abc" if n != me]) for me in "abc") == 1


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
