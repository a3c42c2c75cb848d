"""Old runs go where an age is set, and nothing else does."""

from __future__ import annotations

from datetime import UTC, datetime

from surveilnav.cli.expired_runs import remove_expired_runs

NOW = datetime(2026, 1, 31, 12, 0, 0, tzinfo=UTC)


def test_only_runs_that_are_too_old_go(tmp_path):
    names = (
        "20260131-105959-0a1b",
        "20260131-110001-0a1b",
        "20260101-000000-zzzz",
        "99999999-000000-0a1b",
        "up",
        "mine",
    )
    for name in names:
        (tmp_path / name).mkdir()
        (tmp_path / name / "report.html").write_text("pictures")
    (tmp_path / "20250101-000000-0a1b").write_text("a file")
    (tmp_path / "20250101-000001-0a1b").symlink_to(tmp_path / "mine")
    assert remove_expired_runs(tmp_path, None, NOW) == 0
    assert remove_expired_runs(tmp_path / "none", 1.0, NOW) == 0
    assert remove_expired_runs(tmp_path, 3600.0, NOW) == 1
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {*names[1:], "20250101-000000-0a1b", "20250101-000001-0a1b"}
    assert (tmp_path / "mine" / "report.html").exists()
