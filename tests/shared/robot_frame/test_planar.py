"""Transforms of the plane are a group, and agree with SE(3)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import transform_points
from surveilnav.robot_frame import PlanarTransform

transforms = st.builds(PlanarTransform, st.floats(-50, 50), st.floats(-50, 50), st.floats(-math.pi, math.pi))
places = st.tuples(st.floats(-50, 50), st.floats(-50, 50))


@given(transforms, transforms, places)
def test_a_product_applies_one_after_the_other(a, b, p):
    np.testing.assert_allclose((a @ b).apply(p), a.apply(b.apply(p)), atol=1e-9)


@given(transforms, places)
def test_the_inverse_undoes(a, p):
    np.testing.assert_allclose(a.inverse().apply(a.apply(p)), p, atol=1e-9)
    assert (a @ a.inverse()).difference(PlanarTransform()) == pytest.approx((0, 0), abs=1e-9)


@given(transforms, places, st.floats(-3, 9))
def test_it_is_the_planar_part_of_a_rigid_transform(a, p, z_m):
    x, y, z = transform_points(a.matrix(z_m), np.array([*p, 0.0]))
    np.testing.assert_allclose((x, y), a.apply(p), atol=1e-9)
    assert z == pytest.approx(z_m)
    assert PlanarTransform.from_matrix(a.matrix(z_m)).difference(a) == pytest.approx((0, 0), abs=1e-9)


def test_what_isnt_finite_is_refused():
    with pytest.raises(ValueError, match="finite"):
        PlanarTransform(math.nan, 0, 0)
