"""The link takes one frame at a time, by what the kernel says was acknowledged; and its rate is measured by that."""

from __future__ import annotations

import pytest

from surveilnav.services.camera_node.core.link import Counts, Link

SEGMENT = 1448


def kernel(acknowledged: int, queued: int = 0) -> Counts:
    return Counts(acknowledged, SEGMENT, queued)


def test_the_next_frame_waits_until_all_but_the_last_packet_was_acknowledged():
    link = Link().with_frame(10_000, 5.0, kernel(700))
    last = 700 + 10_000 - SEGMENT
    assert link.at(5.01, kernel(last - 1, 10_000)).frame is not None
    free = link.at(5.02, kernel(last, SEGMENT))
    assert free.frame is None
    assert free.rate_bytes_s == pytest.approx(10_000 / 0.02)


@pytest.mark.parametrize(("took_s", "rest_s"), [(0.02, 0.0), (0.5, 0.5), (4.0, 4.0)])
def test_after_a_frame_that_took_long_the_link_is_left_to_others_for_as_long(took_s, rest_s):
    link = Link().with_frame(800_000, 5.0, kernel(0)).at(5.0 + took_s, kernel(800_000))
    assert link.rests_until_s == pytest.approx(5.0 + took_s + rest_s)


def test_a_frame_of_one_packet_is_never_waited_for():
    assert Link().with_frame(SEGMENT, 5.0, kernel(0)).at(5.0, kernel(0, SEGMENT)).frame is None


def test_the_rate_follows_newer_frames():
    link = Link(rate_bytes_s=1000.0)
    for n in range(20):
        link = link.with_frame(5000, float(n), kernel(0)).at(n + 0.5, kernel(5000))
    assert link.rate_bytes_s == pytest.approx(10_000.0, rel=0.01)


@pytest.mark.parametrize(
    ("queued", "later_s", "waits"),
    [(20_000, 60.0, True), (0, 0.2, True), (0, 0.3, False)],
    ids=["it is under way", "it may not be in the buffer yet", "it was dropped, or the connection is new"],
)
def test_a_frame_that_is_lost_is_not_waited_for_for_ever(queued, later_s, waits):
    link = Link(rate_bytes_s=9.0).with_frame(20_000, 5.0, kernel(70_000)).at(5.0 + later_s, kernel(0, queued))
    assert (link.frame is not None) == waits
    assert link.rate_bytes_s == 9.0


def test_where_the_kernel_cannot_be_asked_nothing_is_waited_for():
    assert Link().with_frame(10_000, 5.0, None).frame is None
    assert Link().with_frame(10_000, 5.0, kernel(0)).at(5.0, None) == Link()
