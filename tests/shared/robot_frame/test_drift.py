"""Who is named when cameras and a robot disagree: by what cameras say, as a table."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.robot_frame import PlanarTransform
from surveilnav.robot_frame.drift import DriftMonitor, is_large

HERE = (4.0, 2.0)
OFF = PlanarTransform(0.5, 0.1, 0.05)
LIKE = PlanarTransform(0.42, 0.16, 0.06)
OTHER = PlanarTransform(-0.6, 0.3, -0.1)


def monitor(*said):
    found = DriftMonitor()
    for words in said:
        found.record(words, HERE)
    return found


@pytest.mark.parametrize(
    ("said", "witnesses", "contradicted"),
    [
        ({"a": OFF}, (), []),
        ({"a": OFF, "b": LIKE}, ("a", "b"), []),
        ({"a": OFF, "b": None}, (), ["a"]),
        ({"a": OFF, "b": OTHER}, (), []),
        ({"a": OFF, "b": LIKE, "c": None}, (), []),
        ({"a": OFF, "b": OTHER, "c": None}, (), ["a", "b"]),
        ({"a": OFF, "b": LIKE, "c": None, "d": OFF}, ("a", "b", "d"), []),
        ({"a": OFF, "b": LIKE, "c": None, "d": None}, (), []),
        ({"a": None, "b": None}, (), []),
    ],
)
def test_who_is_wrong(said, witnesses, contradicted):
    found = monitor(said)
    assert found.witnesses == witnesses
    assert (found.correction is not None) == bool(witnesses)
    assert [camera for camera in said if found.is_contradicted_by(camera, HERE)] == contradicted
    one_by_one = monitor(*({camera: word} for camera, word in said.items()))
    assert (one_by_one.correction is not None) >= bool(witnesses), "one after the other"


def test_believed_again_after_two_comparisons_that_agree():
    found = monitor({"a": OFF, "b": LIKE}, {"a": None})
    assert found.correction is not None
    found.record({}, HERE)  # nobody could be compared
    found.record({"b": OFF}, HERE)
    found.record({"a": None}, HERE)
    assert found.correction is not None, "not in a row"
    found.record({"c": None}, HERE)
    assert found.correction is None
    assert found.corrections == {}


def test_a_new_start_forgets_what_was_said_and_not_that_it_is_wrong():
    found = monitor({"a": OFF, "b": LIKE})
    found.restart()
    assert found.correction is not None
    waiting = monitor({"a": OFF})
    waiting.restart()
    waiting.record({"b": LIKE}, HERE)
    assert waiting.correction is None


@given(
    x=st.floats(-2, 2),
    y=st.floats(-2, 2),
    yaw=st.floats(-0.25, 0.25),
    at=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
)
def test_the_correction_lies_between_what_two_cameras_say(x, y, yaw, at):
    one, other = PlanarTransform(x, y, yaw), PlanarTransform(x, y, yaw) @ PlanarTransform(0.001, -0.002, 0.0005)
    found = DriftMonitor()
    found.record({"a": one, "b": other}, at)
    distance_m, angle_rad = one.difference(other, at)
    if distance_m > 0.2:
        return
    assert found.correction is not None
    for T in (one, other):
        off_m, off_rad = found.correction.difference(T, at)
        assert off_m == pytest.approx(distance_m / 2, abs=1e-6)
        assert off_rad == pytest.approx(angle_rad / 2, abs=1e-6)


def test_from_its_state_it_goes_on():
    found = monitor({"a": OFF, "b": LIKE}, {"c": None})
    assert DriftMonitor.from_state(found.state()) == found
    assert DriftMonitor.from_state(DriftMonitor().state()) == DriftMonitor()


@pytest.mark.parametrize(
    ("correction", "large"),
    [
        (PlanarTransform(0.18, 0.0, math.radians(1.2)), False),
        (PlanarTransform(0.0, 0.3, 0.0), True),
        (PlanarTransform(0.0, 0.0, math.radians(3.0)), True),
    ],
)
def test_what_is_more_than_noise(correction, large):
    assert is_large(correction, (0.0, 0.0)) == large


def test_a_frame_that_one_camera_alone_still_calls_wrong_isnt_known_to_be():
    monitor = DriftMonitor()
    wrong = PlanarTransform(0.5, 0.0, 0.0)
    monitor.record({"a": wrong, "b": wrong}, (0.0, 0.0))
    assert monitor.witnesses == ("a", "b")
    monitor.record({"a": wrong}, (0.0, 0.0))  # another word of the same camera forgets nothing
    assert monitor.correction is not None
    monitor.forget("b")  # it is described anew
    assert (monitor.correction, monitor.witnesses) == (None, ())
