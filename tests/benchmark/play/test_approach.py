"""How near a search came to a goal, and when."""

from __future__ import annotations

import math

import pytest

from surveilnav.benchmark.play.approach import NEAR_M, Approach, approach_of

FAR = NEAR_M + 1.0


@pytest.mark.parametrize(
    ("left_m", "expected"),
    [
        ([FAR, FAR], {"closest_m": FAR}),
        ([math.inf, math.inf], {}),
        ([math.inf, FAR + 1.0, FAR], {"closest_m": FAR}),
        ([2.0, 1.0, 0.0], {"closest_m": 0.0, "first": (0.0, 2.0), "last": (0.0, 2.0)}),
        ([FAR, 2.0, 1.0], {"closest_m": 1.0, "first": (1.0, 2.0), "last": (1.0, 2.0)}),
        ([FAR, NEAR_M, FAR], {"closest_m": NEAR_M, "first": (1.0, NEAR_M)}),  # it left again
        ([2.5, FAR, 2.0, math.inf, 1.5, 0.1], {"closest_m": 0.1, "first": (0.0, 2.5), "last": (4.0, 1.5)}),
    ],
)
def test_first_near_and_near_for_the_last_time(left_m, expected):
    found = approach_of([float(i) for i in range(len(left_m))], left_m)
    first, last = expected.get("first", (None, None)), expected.get("last", (None, None))
    assert found == Approach(
        closest_m=expected.get("closest_m"),
        first_near_path_m=first[0],
        first_near_left_m=first[1],
        last_near_path_m=last[0],
        last_near_left_m=last[1],
    )
    assert found.came_near == ("first" in expected)
