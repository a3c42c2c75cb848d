"""Numbers as people read them."""

from __future__ import annotations

import pytest

from surveilnav.cli.words import human_bytes, why_perceived


@pytest.mark.parametrize(
    ("n", "text"),
    [
        (None, "–"),
        (0, "0 B"),
        (999, "999 B"),
        (1000, "1.0 kB"),
        (9_940, "9.9 kB"),
        (9_960, "10 kB"),
        (81_234_567, "81 MB"),
        (10**16, "10000 TB"),
    ],
)
def test_human_bytes(n, text):
    assert human_bytes(n) == text


def test_what_has_no_table_of_chances_is_called_uncalibrated():
    assert why_perceived("asked for", True) == "asked for"
    assert why_perceived("asked for", False) == "asked for; uncalibrated: scores stand in for chances"
