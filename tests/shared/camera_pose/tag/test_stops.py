"""When a robot stands, and when a camera has seen enough."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.camera_pose.tag.stops import STILL_S, StandstillDetector, SteadyCorners

SQUARE = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 30.0], [0.0, 30.0]])


def test_a_robot_stands_after_two_seconds_at_one_place() -> None:
    detector = StandstillDetector()
    found = [detector.observe(t / 4, 1.0 + 0.005 * (t % 2), 2.0, math.pi * (-1) ** t) for t in range(12)]
    assert [still is not None for still in found] == [t / 4 >= STILL_S for t in range(12)]
    assert found[-1] is not None
    assert (found[-1].since_s, found[-1].x_m, found[-1].y_m) == (0.0, pytest.approx(1.0025, abs=0.003), 2.0)
    assert abs(found[-1].yaw_rad) == pytest.approx(math.pi)
    assert found[-1].since_s == found[-2].since_s  # type: ignore[union-attr]


@pytest.mark.parametrize("step", [(0.05, 0.0, 0.0), (0.0, 0.05, 0.0), (0.0, 0.0, 0.05)])
def test_one_that_creeps_or_turns_doesnt(step: tuple[float, float, float]) -> None:
    detector = StandstillDetector()
    assert not any(detector.observe(float(t), *(t * np.array(step))) for t in range(20))


def test_one_that_goes_on_stands_no_longer_and_then_makes_a_new_stop() -> None:
    detector = StandstillDetector()
    first = [detector.observe(t / 4, 0.0, 0.0, 0.0) for t in range(10)][-1]
    assert detector.observe(2.5, 0.5, 0.0, 0.0) is None
    second = [detector.observe(2.75 + t / 4, 0.5, 0.0, 0.0) for t in range(10)][-1]
    assert first is not None
    assert second is not None
    assert second.since_s == 2.5
    assert second.x_m == 0.5


def test_a_robot_that_was_silent_may_have_moved() -> None:
    detector = StandstillDetector()
    assert detector.observe(0.0, 0.0, 0.0, 0.0) is None
    assert detector.observe(10.0, 0.0, 0.0, 0.0) is None


def test_three_pictures_that_agree_are_enough_and_their_median_counts() -> None:
    corners = SteadyCorners()
    for shift in (0.0, 0.3, 0.1):
        assert not corners.done
        corners.observe(SQUARE + shift)
    assert corners.done
    assert corners.corners_px == pytest.approx(SQUARE + 0.1)


def test_a_delayed_stream_that_still_shows_the_robot_driving_is_waited_for() -> None:
    corners = SteadyCorners()
    for shift in (0.0, 9.0, 18.0, 20.0):
        corners.observe(SQUARE + shift)
    assert not corners.done
    corners.observe(SQUARE + 20.0)
    corners.observe(SQUARE + 20.0)
    assert corners.corners_px == pytest.approx(SQUARE + 20.0)


def test_a_camera_that_doesnt_see_the_tag_isnt_waited_for() -> None:
    corners = SteadyCorners()
    for _ in range(8):
        assert not corners.done
        corners.observe(None)
    assert corners.done
    assert corners.corners_px is None
