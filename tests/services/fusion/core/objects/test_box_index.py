"""The boxes of many shapes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from surveilnav.geometry import camera_pose
from surveilnav.services.fusion.core.objects.box_index import BoxIndex
from surveilnav.services.fusion.core.objects.shape import Shape

points = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-0.25, 0.25))


def shape(p):
    return Shape.from_points(np.asarray(p, float), 0.025, 0.05)


@given(st.lists(st.tuples(st.sampled_from(["put", "remove"]), st.integers(1, 30), points), max_size=60), points)
def test_the_index_finds_what_a_loop_finds(story, p):
    index, shapes = BoxIndex(), {}
    for what, id_, q in story:
        if what == "put":
            shapes[id_] = shape(q + id_ % 5 * 0.3)
            index.put(id_, shapes[id_])
        elif id_ in shapes:
            del shapes[id_]
            index.remove(id_)
    a = shape(p)
    near = [i for i, s in shapes.items() if np.all(s.p_min <= a.p_max + 0.1) and np.all(s.p_max >= a.p_min - 0.1)]
    assert index.near(a, 0.1) == sorted(near)
    T = camera_pose((0.1, 0.2, 0.3), 0.7, -0.2)
    ahead = []
    for i, s in shapes.items():
        d = (s.p_min + s.p_max) / 2 - T[:3, 3]
        if d @ T[:3, 2] > 0 and np.linalg.norm(d) <= 0.8:
            ahead.append(i)
    assert index.in_front_of(T, 0.8) == sorted(ahead)
