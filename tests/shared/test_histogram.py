from __future__ import annotations

import numpy as np
import pytest

from surveilnav.histogram import EDGES_MS, Histogram, quantile_ms


@pytest.mark.parametrize("share", [0.5, 0.95, 1.0])
def test_quantiles_are_those_of_the_numbers_to_a_fifth(share: float) -> None:
    durations_ms = np.random.default_rng(1).lognormal(3.0, 1.0, 500)
    histogram = Histogram()
    for duration_ms in durations_ms:
        histogram.add(float(duration_ms))
    true_ms = float(np.quantile(durations_ms, share, method="inverted_cdf"))
    read_ms = quantile_ms(histogram.counts, share)
    assert read_ms is not None
    assert true_ms <= read_ms <= 1.2 * true_ms


def test_edges_belong_to_the_bucket_below_and_nothing_is_lost() -> None:
    histogram = Histogram()
    for duration_ms in (0.0, EDGES_MS[0], EDGES_MS[-1], 1e9):
        histogram.add(duration_ms)
    assert histogram.counts[0] == 2
    assert histogram.counts[-2:] == [1, 1]
    assert quantile_ms(histogram.counts, 1.0) == EDGES_MS[-1]


def test_counts_that_are_none_have_no_quantile() -> None:
    assert quantile_ms([], 0.5) is None
    assert quantile_ms([0] * (len(EDGES_MS) + 1), 0.5) is None
    assert quantile_ms([1] * 5, 0.5) is None
