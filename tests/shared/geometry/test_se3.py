"""Group axioms and round trips of rigid transforms."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pose, base_pose, camera_pose, inverse, transform_points, yaw_of

angle = st.floats(-math.pi, math.pi)
metre = st.floats(-100, 100)


@st.composite
def rigid(draw):
    """Any rigid transform, from a unit quaternion of four normal-ish numbers."""
    q = np.array([draw(st.floats(-1, 1)) for _ in range(4)])
    norm = np.linalg.norm(q)
    q = q / norm if norm > 1e-3 else np.array([0.0, 0.0, 0.0, 1.0])
    return Pose((draw(metre), draw(metre), draw(metre)), tuple(q)).matrix()


@given(rigid(), rigid(), rigid())
def test_composition_is_associative_and_inverses_cancel(T_a_b, T_b_c, T_c_d):
    np.testing.assert_allclose((T_a_b @ T_b_c) @ T_c_d, T_a_b @ (T_b_c @ T_c_d), atol=1e-9)
    np.testing.assert_allclose(T_a_b @ inverse(T_a_b), np.eye(4), atol=1e-9)


@given(rigid())
def test_a_pose_survives_the_wire(T):
    np.testing.assert_allclose(Pose.from_matrix(T).matrix(), T, atol=1e-9)


@given(rigid())
def test_distances_are_kept(T):
    p = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    q = transform_points(T, p)
    assert np.linalg.norm(q[1] - q[0]) == pytest.approx(math.sqrt(14))


@given(angle, st.floats(-1.5, 1.5), metre)
def test_a_camera_looks_where_it_is_told(yaw, pitch, x):
    T = camera_pose((x, 2.0, 1.0), yaw, pitch)
    forward = T[:3, :3] @ [0, 0, 1]
    expected = [math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), math.sin(pitch)]
    np.testing.assert_allclose(forward, expected, atol=1e-12)
    assert T[2, 0] == pytest.approx(0)  # its x axis stays level: no roll
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)


@given(angle)
def test_yaw_of_a_base(yaw):
    assert math.cos(yaw_of(base_pose((0, 0, 0), yaw)) - yaw) == pytest.approx(1)


@pytest.mark.parametrize(
    "pose", [((0, 0, math.nan), (0, 0, 0, 1)), ((0, 0, 0), (0, 0, 0, 2)), ((0, 0, 0), (0, 0, 0, 0))]
)
def test_poses_that_are_none_are_refused(pose):
    with pytest.raises(ValueError, match=r"finite|unit quaternion"):
        Pose(*pose)
