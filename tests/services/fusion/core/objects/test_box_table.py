"""The boxes of many shapes."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from surveilnav.geometry import camera_pose
from surveilnav.services.fusion.core.objects.box_table import BoxTable
from surveilnav.services.fusion.core.objects.shape import Shape

points = hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=st.floats(-0.25, 0.25))


def shape(p):
    return Shape.of_points(np.asarray(p, float), 0.025, 0.05)


@given(st.lists(st.tuples(st.sampled_from(["put", "drop"]), st.integers(1, 30), points), max_size=60), points)
def test_the_table_of_boxes_finds_what_a_loop_finds(story, p):
    table, shapes = BoxTable(), {}
    for what, id_, q in story:
        if what == "put":
            shapes[id_] = shape(q + id_ % 5 * 0.3)
            table.put(id_, shapes[id_])
        elif id_ in shapes:
            del shapes[id_]
            table.drop(id_)
    a = shape(p)
    near = [i for i, s in shapes.items() if np.all(s.p_min <= a.p_max + 0.1) and np.all(s.p_max >= a.p_min - 0.1)]
    assert table.touching(a, 0.1) == sorted(near)
    T = camera_pose((0.1, 0.2, 0.3), 0.7, -0.2)
    before = []
    for i, s in shapes.items():
        d = (s.p_min + s.p_max) / 2 - T[:3, 3]
        if d @ T[:3, 2] > 0 and np.linalg.norm(d) <= 0.8:
            before.append(i)
    assert table.before(T, 0.8) == sorted(before)
