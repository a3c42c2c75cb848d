"""How much of the log is kept beyond what a restart needs."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.fusion.map_log.retention import NO_RETENTION, Retention, oldest_base, superfluous_snapshots


@given(
    snapshots=st.lists(st.integers(0, 300), min_size=2, max_size=12, unique=True).map(sorted),
    first=st.integers(1, 300),
    more=st.integers(0, 50),
    retention=st.builds(Retention, st.integers(0, 400), st.integers(0, 4000)),
)
def test_the_log_begins_at_a_snapshot_and_is_neither_too_short_nor_too_long(snapshots, first, more, retention):
    first, last = min(first, snapshots[-2] + 1), snapshots[-1] + more
    base = oldest_base(snapshots, first, last, lambda after: 10 * (last - after), retention)
    needed = snapshots[-2]
    assert base <= needed, "a restart must be possible without the newest snapshot"
    assert base in snapshots or (base == 0 and first == 1)
    assert base >= first - 1, "before that there are no views"
    if base != needed:
        assert last - base <= retention.views
        assert 10 * (last - base) <= retention.n_bytes
    kept = dict(enumerate(snapshots))
    left = [up_to for id, up_to in kept.items() if id not in superfluous_snapshots(kept, base, retention)]
    assert left[-2:] == snapshots[-2:]
    assert base in left or base == 0
    assert all(up_to >= base for up_to in left)
    assert len(left) <= 2 + 1 + 5


def test_without_retention_two_snapshots_and_the_log_between_them_are_left():
    assert oldest_base([10, 20, 30], 1, 35, lambda after: 0, NO_RETENTION) == 20
    assert superfluous_snapshots({1: 10, 2: 20, 3: 30}, 20, NO_RETENTION) == [1]


def test_of_two_snapshots_that_go_equally_far_the_newer_is_left():
    """The older one may hold what was removed since."""
    assert superfluous_snapshots({1: 10, 2: 20, 3: 20, 4: 30, 5: 40}, 10, Retention(40, 1000)) == [2]
