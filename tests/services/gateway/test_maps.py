"""Which kept picture of a layer will do."""

from __future__ import annotations

import pytest

from services.gateway.core.layers import Drawn
from services.gateway.maps import Kept
from surveilnav.geometry import Grid
from surveilnav.messages import Revision


def revision(number: int, stamp_ns: int) -> Revision:
    return Revision(
        stamp_ns=stamp_ns, floor="0", revision=number, floor_z_m=0.0, robots={}, cameras=[], pending_views=0
    )


@pytest.mark.parametrize(
    ("newest", "least", "will_do"),
    [
        (revision(7, 70), None, True),
        (revision(8, 80), None, False),
        (revision(8, 80), 7, True),
        (revision(8, 80), 8, False),
        (revision(7, 71), None, False),  # another fusion, which happens to be as far
        (revision(3, 90), 2, False),  # it started anew, and counts from 1 again
    ],
)
def test_a_kept_picture_will_do(newest, least, will_do):
    kept = Kept(Drawn(b"", Grid(0.0, 0.0, 0.05, 1, 1)), 7, 7, 70)
    assert kept.shows(newest, least) is will_do


def test_one_that_shows_more_than_was_known_serves_who_asks_for_as_much():
    kept = Kept(Drawn(b"", Grid(0.0, 0.0, 0.05, 1, 1)), revision=9, known=7, stamp_ns=0)
    assert kept.shows(revision(8, 80), 9)
    assert not kept.shows(revision(9, 90), None), "it isn't known to be of the same fusion"
