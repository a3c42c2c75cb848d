"""The link takes one frame at a time, by what the kernel says was acknowledged; and its rate is measured by that."""

from __future__ import annotations

import pytest

from surveilnav.services.camera_node.core.link import Counts, Link

SEGMENT = 1448


def kernel(acknowledged: int, queued: int = 0, round_trip_s: float = 0.0) -> Counts:
    return Counts(acknowledged, queued, SEGMENT, round_trip_s)


def watched(link: Link, until_s: float, counts: Counts) -> Link:
    """The link after somebody has looked at it all the time."""
    now_s = link.frame.sent_s
    while now_s < until_s - 0.02:
        now_s += 0.02
        link = link.at(now_s, counts)
    return link


def arrived(took_s: float, n_bytes: int = 800_000, link: Link | None = None, round_trip_s: float = 0.0) -> Link:
    """The link after a frame that was sent at 5 s took so long."""
    link = (link or Link()).with_frame(n_bytes, 5.0, kernel(0))
    waiting, there = kernel(0, n_bytes, round_trip_s), kernel(n_bytes, 0, round_trip_s)
    return watched(link, 5.0 + took_s, waiting).at(5.0 + took_s, there)


def test_the_next_frame_waits_until_all_but_the_last_packet_was_acknowledged():
    link = Link().with_frame(10_000, 5.0, kernel(700))
    last = 700 + 10_000 - SEGMENT
    assert link.at(5.01, kernel(last - 1, 10_000)).frame is not None
    free = link.at(5.02, kernel(last, SEGMENT))
    assert free.frame is None
    assert free.n_timed == 1
    assert free.rate_bytes_s == pytest.approx(10_000 / 0.02)


def test_what_was_queued_before_doesnt_count():
    link = Link().with_frame(10_000, 5.0, kernel(700, queued=50_000))
    assert link.at(5.01, kernel(700 + 10_000, 50_000)).frame is not None
    assert link.at(5.01, kernel(700 + 60_000)).frame is None


def test_a_frame_of_one_packet_is_never_waited_for_and_tells_no_rate():
    link = Link().with_frame(SEGMENT, 5.0, kernel(0)).at(5.0, kernel(0, SEGMENT))
    assert link == Link()


@pytest.mark.parametrize(("took_s", "rest_s"), [(0.5, 0.5), (4.0, 4.0), (60.0, 5.0)])
def test_after_a_frame_that_took_long_the_link_is_left_to_others_for_as_long(took_s, rest_s):
    assert arrived(took_s).rests_until_s == pytest.approx(5.0 + took_s + rest_s)


@pytest.mark.parametrize(("took_s", "round_trip_s"), [(0.02, 0.0), (0.3, 0.25)])
def test_a_fast_link_doesnt_rest_however_long_its_way(took_s, round_trip_s):
    link = arrived(took_s, round_trip_s=round_trip_s)
    assert link.rests_until_s < 5.0
    assert link.rate_bytes_s == pytest.approx(800_000 / (took_s - round_trip_s))


@pytest.mark.parametrize("idle_s", [0.2, 600.0])
def test_who_doesnt_look_learns_that_it_arrived_and_not_when(idle_s):
    link = Link(rate_bytes_s=9.0).with_frame(800_000, 5.0, kernel(0)).at(5.0 + idle_s, kernel(800_000))
    assert link == Link(rate_bytes_s=9.0)


def test_the_rate_follows_newer_frames():
    link = Link(rate_bytes_s=1000.0)
    for _ in range(20):
        link = arrived(0.5, 5000, link)
    assert link.rate_bytes_s == pytest.approx(10_000.0, rel=0.01)


@pytest.mark.parametrize(
    ("queued", "later_s", "waits"),
    [(20_000, 60.0, True), (0, 0.2, True), (0, 0.3, False)],
    ids=["it is under way", "it may not be in the buffer yet", "it was dropped, or the connection is new"],
)
def test_a_frame_that_is_lost_is_not_waited_for_for_ever(queued, later_s, waits):
    link = Link(rate_bytes_s=9.0).with_frame(20_000, 5.0, kernel(70_000)).at(5.0 + later_s, kernel(0, queued))
    assert (link.frame is not None) == waits
    assert (link.rate_bytes_s, link.n_timed) == (9.0, 0)


def test_where_the_kernel_cannot_be_asked_nothing_is_waited_for():
    assert Link().with_frame(10_000, 5.0, None).frame is None
    assert Link().with_frame(10_000, 5.0, kernel(0)).at(5.0, None) == Link()
