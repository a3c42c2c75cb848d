"""The tree of frames against literal products of matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pose, base_pose
from surveilnav.geometry.se3 import inverse
from surveilnav.services.robot_node.bodies.ros2.transforms import (
    TransformBuffer,
    TransformError,
    TransformPendingError,
)

S = 10**9


def pose(x=0.0, y=0.0, yaw=0.0, z=0.0):
    return Pose.from_matrix(base_pose((x, y, z), yaw))


@pytest.fixture
def tree():
    """map -> odom -> base_link -> camera, as robots publish it."""
    buffer = TransformBuffer()
    buffer.add("map", "odom", 10 * S, pose(5.0, 1.0, 0.5))
    for k in range(11):
        buffer.add("odom", "base_link", 10 * S + k * S // 10, pose(0.1 * k, 0.0, 0.2 * k))
    buffer.add("base_link", "camera", 0, pose(0.1, 0.0, 0.0, 0.9), static=True)
    return buffer


def test_a_chain_is_the_product_of_its_transforms(tree):
    T = tree.lookup("map", "camera", 10 * S + S // 2, hold_ns=S)
    expected = base_pose((5.0, 1.0, 0.0), 0.5) @ base_pose((0.5, 0.0, 0.0), 1.0) @ base_pose((0.1, 0.0, 0.9), 0.0)
    np.testing.assert_allclose(T, expected, atol=1e-9)
    np.testing.assert_allclose(tree.lookup("camera", "map", 10 * S + S // 2, hold_ns=S), inverse(expected), atol=1e-9)


def test_siblings_meet_at_their_common_ancestor(tree):
    tree.add("base_link", "laser", 0, pose(-0.2, 0.0, math.pi), static=True)
    T = tree.lookup("laser", "camera", 10 * S)
    np.testing.assert_allclose(T, inverse(base_pose((-0.2, 0, 0), math.pi)) @ base_pose((0.1, 0, 0.9), 0.0), atol=1e-9)


@given(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(0.0, 1.0), st.floats(-5, 5))
def test_between_two_transforms_it_moves_and_turns_evenly(yaw, turn, share, x):
    buffer = TransformBuffer()
    buffer.add("odom", "base", 0, pose(x, 0.0, yaw))
    buffer.add("odom", "base", S, pose(x + 1.0, 2.0, yaw + turn))
    T = buffer.lookup("odom", "base", round(share * S))
    np.testing.assert_allclose(T, base_pose((x + share, 2.0 * share, 0.0), yaw + share * turn), atol=1e-6)


def test_a_moment_after_the_newest_transform_is_pending_unless_it_holds(tree):
    with pytest.raises(TransformPendingError, match=r"odom -> base_link is 0\.50 s older"):
        tree.lookup("odom", "base_link", 11 * S + S // 2)
    tree.lookup("odom", "base_link", 11 * S + S // 2, hold_ns=S)


def test_a_moment_before_all_that_is_kept_is_an_error(tree):
    with pytest.raises(TransformError, match="so far back"):
        tree.lookup("odom", "base_link", 9 * S)


def test_frames_that_nothing_joins_are_named(tree):
    with pytest.raises(
        TransformError, match="no transform leads from 'gripper' to 'map'; frames that have one: base_link"
    ):
        tree.lookup("map", "gripper")


def test_a_cycle_ends():
    buffer = TransformBuffer()
    buffer.add("a", "b", 0, pose(1.0))
    buffer.add("b", "a", 0, pose(1.0))
    with pytest.raises(TransformError):
        buffer.lookup("map", "a")


def test_a_clock_that_was_set_back_begins_a_new_history(tree):
    tree.add("odom", "base_link", 2 * 10**9 - 30 * S, pose(9.0))
    np.testing.assert_allclose(tree.lookup("odom", "base_link")[0, 3], 9.0)


def test_a_repeated_or_late_transform_changes_nothing(tree):
    tree.add("odom", "base_link", 10 * S, pose(7.0))
    np.testing.assert_allclose(tree.lookup("odom", "base_link", 10 * S)[0, 3], 0.0)


def test_the_number_of_frames_is_limited():
    buffer = TransformBuffer()
    for k in range(2000):
        buffer.add("map", f"f{k}", 0, pose(1.0))
    with pytest.raises(TransformError):
        buffer.lookup("map", "f1999")
    buffer.lookup("map", "f0")
