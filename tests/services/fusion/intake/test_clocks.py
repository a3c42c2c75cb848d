from __future__ import annotations

from surveilnav.services.fusion.intake.clocks import SourceClocks

HOUR, SECOND = 3600 * 10**9, 10**9


def test_times_that_can_be_are_left_alone() -> None:
    clocks = SourceClocks()
    for stamp in (0, 99 * SECOND, 100 * SECOND, 101 * SECOND):
        assert clocks.corrected_ns("camera/a", stamp, 100 * SECOND) == stamp


def test_a_clock_an_hour_ahead_is_not_believed_but_the_order_is() -> None:
    clocks, now = SourceClocks(), 1000 * SECOND
    corrected = []
    for taken_s, delay_s in ((0, 0.2), (1, 0.05), (2, 0.3), (3, 0.1)):
        taken = now + taken_s * SECOND
        arrived = taken + int(delay_s * SECOND)
        corrected.append(clocks.corrected_ns("camera/a", taken + HOUR, arrived))
        assert abs(corrected[-1] - taken) < 0.5 * SECOND
    assert corrected == sorted(set(corrected))
    assert clocks.corrected_ns("camera/a", now + 3 * SECOND + HOUR, now + 60 * SECOND) == corrected[-1], (
        "an old picture"
    )
    assert clocks.corrected_ns("camera/b", now, now) == now


def test_a_clock_that_is_set_right_is_believed_again() -> None:
    clocks, now = SourceClocks(), 1000 * SECOND
    assert clocks.corrected_ns("camera/a", now + HOUR, now) == now
    assert clocks.corrected_ns("camera/a", now + 5 * SECOND, now + 5 * SECOND) == now + 5 * SECOND
