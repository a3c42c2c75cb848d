"""Which recordings go: the oldest, until the rest fits; never one that is being written."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.recorder.core.limits import Limits, RecordingFileInfo, files_to_delete

DAY_NS = 86_400 * 10**9


@pytest.mark.parametrize(
    ("files", "limits", "gone"),
    [
        ([("a", 4, 1), ("b", 4, 2), ("c", 4, 3)], Limits(12, 0), []),
        ([("a", 4, 1), ("b", 4, 2), ("c", 4, 3)], Limits(11, 0), ["a"]),
        ([("a", 4, 1), ("b", 4, 2), ("c", 4, 3)], Limits(4, 0), ["a", "b"]),
        ([("a", 4, 1), ("b", 4, 2), ("c", 4, 3)], Limits(3, 0), ["a", "b", "c"]),
        ([("a", 4, 1), ("b", 4, 2), ("c", 4, 3)], Limits(0, 0), []),
        ([("a", 4, 1), ("b", 4, 2), ("c", 4, 3)], Limits(0, 8), ["a"]),  # at time 10
        ([("b", 4, 2), ("a", 4, 2)], Limits(7, 0), ["a"]),
        ([], Limits(1, 1), []),
    ],
)
def test_the_oldest_go_first(files, limits, gone):
    assert files_to_delete([RecordingFileInfo(*f) for f in files], limits, now_ns=10) == gone


def test_one_that_is_being_written_stays_and_counts():
    files = [RecordingFileInfo("a", 90, 1, is_open=True), RecordingFileInfo("b", 20, 2), RecordingFileInfo("c", 20, 3)]
    assert files_to_delete(files, Limits(100, 0), now_ns=4) == ["b", "c"]
    assert files_to_delete(files, Limits(0, 1), now_ns=4) == ["b"]  # "a" is older, "c" just young enough


FILES = st.lists(
    st.builds(RecordingFileInfo, st.uuids().map(str), st.integers(0, 1000), st.integers(0, 50 * DAY_NS), st.booleans()),
    max_size=20,
)


@given(FILES, st.integers(0, 5000), st.integers(0, 60 * DAY_NS))
def test_what_stays_fits_and_is_newer_than_what_went_for_room(files, n_bytes, age_ns):
    now_ns = 60 * DAY_NS
    gone = set(files_to_delete(files, Limits(n_bytes, age_ns), now_ns))
    stays, went = [f for f in files if f.id not in gone], [f for f in files if f.id in gone]
    assert not any(f.is_open for f in went)
    closed = [f for f in stays if not f.is_open]
    if age_ns:
        assert all(now_ns - f.started_ns <= age_ns for f in closed)
    if n_bytes:
        assert sum(f.n_bytes for f in stays) <= n_bytes or not closed
    assert all(a.started_ns <= b.started_ns for a in went for b in closed)
    by_age = [f for f in went if age_ns and now_ns - f.started_ns > age_ns]
    for_room = [f for f in went if f not in by_age]
    if for_room:  # without the last of them it would have been too much
        assert 0 < n_bytes < sum(f.n_bytes for f in stays) + max(for_room, key=lambda f: (f.started_ns, f.id)).n_bytes
