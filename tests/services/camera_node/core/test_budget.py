"""The budget: kept over any time, whatever the sizes of frames; and which tier a view gets from it."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.camera_node.core.budget import TokenBucket, soon_bytes, tier_of, views_to_improve
from surveilnav.services.camera_node.core.link import Link

RATE = 1000.0


def sent(sizes, seconds: float, step_s: float = 0.01) -> tuple[float, float]:
    """Sends frames of these sizes, over and over, as soon as the budget allows; the bytes of all, and of the largest."""
    bucket, total, i = TokenBucket.full(RATE, 0.0), 0, 0
    for n in range(round(seconds / step_s)):
        bucket = bucket.at(n * step_s)
        if bucket.allows:
            bucket, total, i = bucket.without(sizes[i % len(sizes)]), total + sizes[i % len(sizes)], i + 1
    return total, max(sizes)


@given(st.lists(st.integers(1, 5000), min_size=1, max_size=5), st.floats(1.0, 50.0))
def test_over_any_time_the_budget_is_kept_but_for_a_burst_and_a_frame(sizes, seconds):
    total, largest = sent(sizes, seconds)
    assert total <= RATE * seconds + 2 * RATE + largest


def test_the_budget_is_used_within_two_percent():
    total, _ = sent([300, 700, 90], 1000.0)
    assert total == pytest.approx(RATE * 1000.0, rel=0.02)


def test_a_frame_larger_than_the_bucket_is_sent_and_paid_for():
    bucket = TokenBucket.full(RATE, 0.0)
    assert bucket.allows
    owing = bucket.without(10_000)
    assert not owing.at(7.9).allows
    assert owing.at(8.1).allows


def test_a_clock_that_goes_back_fills_nothing():
    empty = TokenBucket(RATE, -1.0, 100.0)
    assert not empty.at(50.0).allows
    assert empty.at(50.0).at(50.1).allows


FULL, EMPTY = TokenBucket(RATE, 2 * RATE, 0.0), TokenBucket(RATE, 0.0, 0.0)


@pytest.mark.parametrize(
    ("choice", "pictures_wanted", "n_waiting", "bucket", "mean_bytes", "tier"),
    [
        ("raw", (), 1, None, 0.0, "raw"),
        ("jpeg+depth", (0,), 50, EMPTY, 0.0, "jpeg+depth"),
        ("jpeg", (0,), 1, None, 0.0, "jpeg"),  # has no more to give
        ("features", (), 50, EMPTY, 0.0, "features"),
        ("features", (0,), 1, None, 0.0, "jpeg+depth"),
        ("objects", (0,), 1, None, 0.0, "jpeg+depth"),
        ("auto", (), 13, None, 0.0, "features"),
        ("auto", (0,), 13, EMPTY, 0.0, "jpeg+depth"),
        ("auto", (1,), 13, FULL, 500.0, "features"),  # 6.5 kB of the 7 kB of the next five seconds
        ("auto", (), 15, FULL, 500.0, "objects"),
        ("auto", (), 9, EMPTY, 500.0, "features"),
        ("auto", (), 11, EMPTY, 500.0, "objects"),
        ("auto", (), 1, EMPTY, 0.0, "objects"),  # nothing was sent yet: 9 kB are expected
    ],
)
def test_the_tier_of_a_view(choice, pictures_wanted, n_waiting, bucket, mean_bytes, tier):
    soon = soon_bytes(bucket, Link())
    got = tier_of(
        choice, 0, pictures_wanted=pictures_wanted, n_waiting=n_waiting, soon_bytes=soon, mean_bytes=mean_bytes
    )
    assert got == tier


@pytest.mark.parametrize(
    ("bucket", "rate_bytes_s", "bytes_"),
    [
        (None, None, math.inf),
        (None, 200.0, 1000.0),
        (FULL, None, 7000.0),
        (FULL, 200.0, 1000.0),
        (EMPTY, 2000.0, 5000.0),
    ],
)
def test_what_can_be_sent_soon_is_the_less_of_budget_and_link(bucket, rate_bytes_s, bytes_):
    assert soon_bytes(bucket, Link(rate_bytes_s=rate_bytes_s)) == bytes_


@pytest.mark.parametrize(
    ("choice", "sent", "pictures_wanted", "bucket", "better"),
    [
        ("auto", {0: "features", 1: "objects", 2: "objects"}, (), None, {1: "features", 2: "features"}),
        (
            "auto",
            {0: "features", 1: "objects", 2: "objects"},
            (2, 0),
            FULL,
            {0: "jpeg+depth", 2: "jpeg+depth", 1: "features"},
        ),
        ("auto", {0: "objects"}, (), EMPTY, {}),
        ("auto", {0: "jpeg+depth"}, (), None, {}),  # its own perception had failed
        ("objects", {0: "objects", 1: "objects"}, (1,), None, {1: "jpeg+depth"}),
        ("features", {0: "jpeg+depth"}, (0,), None, {}),
        ("features", {}, (0,), None, {}),  # it is due all the same
        ("jpeg+depth", {0: "jpeg+depth"}, (0,), None, {}),
        ("jpeg", {0: "jpeg"}, (0,), None, {}),  # it has no more to give
        ("raw", {0: "raw"}, (0,), None, {}),
    ],
)
def test_views_that_should_be_sent_as_more_than_they_were(choice, sent, pictures_wanted, bucket, better):
    found = views_to_improve(choice, sent, pictures_wanted, bucket)
    assert list(found.items()) == list(better.items())
