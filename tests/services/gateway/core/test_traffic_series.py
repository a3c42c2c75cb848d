"""Bytes over time."""

from __future__ import annotations

import random
from collections import Counter

import pytest

from surveilnav.services.gateway.core.traffic_series import FIRST_S, KEPT, TrafficSeries

NOTHING = (0, 0, 0, 0)


def started(at_s: float = 0.0) -> TrafficSeries:
    """A series that has run long enough for every node to have reported."""
    series = TrafficSeries()
    series.record({"a": NOTHING}, at_s - FIRST_S)
    return series


def test_a_step_has_what_was_counted_in_it():
    series = started()
    series.record({"a": (100, 20, 3, 0)}, 10.2)
    series.record({"a": (150, 20, 3, 9)}, 10.9)
    series.record({"a": (151, 20, 3, 9)}, 75.0)
    assert series.since(1, 0, 100) == [(10, (150, 20, 3, 9)), (75, (1, 0, 0, 0))]
    assert series.since(60, 0, 100) == [(0, (150, 20, 3, 9)), (60, (1, 0, 0, 0))]
    assert series.since(1, 11, 100) == [(75, (1, 0, 0, 0))]
    assert series.since(1, 0, 74) == [(10, (150, 20, 3, 9))]


def test_what_was_before_the_beginning_is_no_news():
    series = TrafficSeries()
    series.record({"a": (1000, 0, 0, 0)}, 5.0)
    series.record({"a": (1001, 0, 0, 0)}, 6.0)
    series.record({"a": (1001, 0, 0, 0), "b": (5_000_000, 0, 0, 0)}, 34.0)  # which reports every half minute
    series.record({"a": (1001, 0, 0, 0), "b": (5_000_002, 0, 0, 0)}, 64.0)
    series.record({"c": (7, 0, 0, 0)}, 66.0)
    assert series.since(1, 0, 100) == [(6, (1, 0, 0, 0)), (64, (2, 0, 0, 0)), (66, (7, 0, 0, 0))]


def test_a_node_that_is_new_or_began_anew_brings_all_that_it_has_counted():
    series = started()
    series.record({"a": (100, 0, 0, 0)}, 1.0)
    series.record({"a": (30, 0, 0, 0), "b": (7, 0, 0, 0)}, 2.0)
    assert series.since(1, 0, 10) == [(1, (100, 0, 0, 0)), (2, (37, 0, 0, 0))]


def test_a_node_that_is_gone_takes_nothing_back():
    series = started()
    series.record({"a": (100, 0, 0, 0), "b": (50, 0, 0, 0)}, 1.0)
    series.record({"a": (100, 0, 0, 0)}, 2.0)
    series.record({"a": (100, 0, 0, 0), "b": (60, 0, 0, 0)}, 3.0)
    assert series.since(1, 0, 10) == [(1, (150, 0, 0, 0)), (3, (10, 0, 0, 0))]


@pytest.mark.parametrize("step_s", KEPT)
def test_no_more_is_kept_than_is_promised(step_s):
    series, kept = started(), KEPT[step_s]
    for n in (0, 1, 5, kept - 1, kept, kept + 1):
        series.record({"a": (n + 1, 0, 0, 0)}, n * step_s)
    found = series.since(step_s, 0, (kept + 1) * step_s)
    assert [p.at_s // step_s for p in found] == [5, kept - 1, kept, kept + 1]


def test_nothing_is_lost_or_counted_twice():
    """Held against a literal sum, over nodes that report now and then and begin anew."""
    chance, series, totals, expected = random.Random(3), started(1000.0), {"a": NOTHING}, Counter()
    for step in range(400):
        now_s = 1000.0 + 0.7 * step
        for node in chance.sample("abc", chance.randrange(3)):
            before = totals.get(node, NOTHING)
            if chance.random() < 0.05:
                before = NOTHING
            added = (1 + chance.randrange(100), 0, chance.randrange(5), 0)
            if before == NOTHING and node in totals and sum(added) >= sum(totals[node]):
                continue  # a node that has already sent more than before can't be told from one that went on
            totals[node] = tuple(b + n for b, n in zip(before, added, strict=True))
            expected[int(now_s)] += sum(added)
        series.record(dict(totals), now_s)
    assert {p.at_s: sum(p.n_bytes) for p in series.since(1, 0, 2000)} == {s: n for s, n in expected.items() if n}


def test_a_clock_that_is_set_back_breaks_nothing():
    series = started(10_000.0)
    series.record({"a": (5, 0, 0, 0)}, 10_000.0)
    series.record({"a": (9, 0, 0, 0)}, 10_000.0 - 3600.0)
    assert series.since(1, 0, 10_000) == [(10_000, (5, 0, 0, 0))]


def test_no_other_steps():
    with pytest.raises(KeyError):
        started().since(7, 0, 1)
