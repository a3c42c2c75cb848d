"""Sets of sources under small numbers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.fusion.core.maps import provenance
from surveilnav.services.fusion.core.maps.provenance import MANY, SourceSets

names = st.lists(st.sampled_from(["robot/a", "robot/b", "camera/c", "camera/d"]), max_size=6)


def joined(sets, members):
    number = 0
    for name in members:
        number = sets.with_source(number, name)
    return number


@given(one=names, other=names)
def test_a_set_has_one_number_whatever_the_way_to_it(one, other):
    sets = SourceSets()
    a, b = joined(sets, one), joined(sets, other)
    assert (a == b) == (set(one) == set(other))
    assert sets.lists()[a] == sorted(set(one))
    again = SourceSets.from_lists(sets.lists())
    assert joined(again, other) == b
    assert again.lists() == sets.lists()


def test_beyond_the_limit_sets_are_not_told_apart(monkeypatch):
    monkeypatch.setattr(provenance, "MAX_SETS", 8)
    sets = SourceSets()
    numbers = [sets.with_source(0, f"camera/{i}") for i in range(20)]
    assert len(sets) == 8
    assert sets.lists()[numbers[-1]] == [MANY]
    assert sets.with_source(numbers[-1], "robot/r") == numbers[-1]
    assert sets.lists()[numbers[3]] == ["camera/3"]  # what was known stays known


@pytest.mark.parametrize("seed", range(3))
def test_a_thousand_cameras_need_no_bits_each(seed):
    rng = np.random.default_rng(seed)
    sets = SourceSets()
    numbers = [joined(sets, [f"camera/{k}" for k in rng.integers(0, 1000, 3)]) for _ in range(2000)]
    assert max(numbers) < 6001
    assert sets.lists()[numbers[-1]] == sorted(sets.lists()[numbers[-1]])
