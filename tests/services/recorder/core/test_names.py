"""Names of recordings: there and back, in the order of time, and nothing else is taken for one."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.contract import ID
from surveilnav.services.recorder.core.names import parse_recording_id, recording_id

TIMES = st.integers(0, 4 * 10**18).map(lambda ns: ns // 10**6 * 10**6)


@given(TIMES, st.from_regex(re.compile(ID), fullmatch=True))
def test_a_name_says_when_and_which_mission(started_ns, mission):
    assert parse_recording_id(recording_id(started_ns, mission)) == (started_ns, mission)


@given(TIMES, TIMES)
def test_names_sort_by_time(a, b):
    assert (recording_id(a, "m") < recording_id(b, "m")) == (a < b)


@pytest.mark.parametrize(
    "id",
    [
        "",
        "notes",
        "../../etc/passwd",
        "20261125T143519250Z_",
        "20261125T143519250Z_../x",
        "20261125T143519250Z_a/b",
        "20261341T143519250Z_m1",
        "20261125T143519Z_m1",
        "20261125T143519.250Z_m1",
        "20261125T143519250Z_m1\n",
        "20261125T143519250Z_" + "m" * 65,
    ],
)
def test_what_is_no_name(id):
    assert parse_recording_id(id) is None
