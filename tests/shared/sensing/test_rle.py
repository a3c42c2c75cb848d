"""Run lengths against a literal reading of their definition."""

from __future__ import annotations

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given, settings

from surveilnav.errors import WireError
from surveilnav.sensing import rle


def written_slowly(mask: np.ndarray) -> list[int]:
    """One cell after the other, column by column, from top to bottom; the first run is outside."""
    runs, inside = [0], False
    for x in range(mask.shape[1]):
        for y in range(mask.shape[0]):
            if bool(mask[y, x]) != inside:
                runs.append(0)
                inside = not inside
            runs[-1] += 1
    return runs


@settings(max_examples=100, deadline=None)
@given(hnp.arrays(np.bool_, hnp.array_shapes(min_dims=2, max_dims=2, max_side=30)))
def test_round_trip_and_the_slow_reference(mask: np.ndarray) -> None:
    runs = rle.encode(mask)
    assert runs == written_slowly(mask)
    np.testing.assert_array_equal(rle.decode(runs, mask.shape[1], mask.shape[0]), mask)


def test_columns_come_first() -> None:
    mask = np.array([[False, True], [False, True], [True, True]])
    assert rle.encode(mask) == [2, 4]
    assert rle.encode(~mask) == [0, 2, 4]


@pytest.mark.parametrize(
    "runs", [[], [5], [7], [-1, 7], [2, 0, 4], [2, -2, 6], [1] * 8, [2**63, 6], [3, 3, 2**62], [0]]
)
def test_runs_that_lie(runs: list[int]) -> None:
    with pytest.raises(WireError, match="mask"):
        rle.decode(runs, 2, 3)


def test_an_empty_mask_has_no_runs() -> None:
    with pytest.raises(ValueError, match="cell"):
        rle.encode(np.zeros((0, 4), bool))
