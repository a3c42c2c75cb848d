"""The access log: what it holds, that it outlives the process, and that it stays within its bounds."""

from __future__ import annotations

import json
from datetime import UTC, datetime, timedelta

import pytest
from structlog.testing import capture_logs

from surveilnav.services.gateway import access_log
from surveilnav.services.gateway.access_log import AccessLog
from tests.waiting import until

NOON = datetime(2026, 1, 31, 12, tzinfo=UTC)


def lines(folder, log=None):
    if log is not None:
        log.flush()
    return [json.loads(line) for file in sorted(folder.glob("*.jsonl")) for line in file.read_text().splitlines()]


def test_an_access_is_a_line_and_outlives_the_process(tmp_path):
    log = AccessLog(tmp_path / "looks")
    log.add("10.0.0.1", "c1", 3, "latest", NOON)
    log.add("10.0.0.2", "c2", 0, "tile", NOON + timedelta(seconds=1))
    assert lines(tmp_path / "looks", log)[0] == {
        "time": "2026-01-31T12:00:00Z",
        "client": "10.0.0.1",
        "camera": "c1",
        "view": 3,
        "what": "latest",
    }
    again = AccessLog(tmp_path / "looks")
    assert [(k.client, k.view, k.what) for k in again.records_of("c1", NOON)] == [("10.0.0.1", 3, "latest")]
    again.add("10.0.0.1", "c1", 4, "latest", NOON + timedelta(minutes=1))
    assert [k.view for k in again.records_of("c1", NOON)] == [4, 3], "newest first"
    assert len(lines(tmp_path / "looks", again)) == 3


def test_a_client_that_keeps_watching_is_recorded_once_a_minute(monkeypatch):
    times_s = [100.0, 101.0, 159.0, 161.0, 162.0, 163.0, 163.0, 163.0]
    monkeypatch.setattr(access_log.time, "monotonic", lambda: times_s.pop(0))
    log = AccessLog()
    for _ in range(5):
        log.add("10.0.0.1", "c1", 3, "latest", NOON)
    assert len(log.records_of("c1", NOON)) == 2
    log.add("10.0.0.2", "c1", 3, "latest", NOON)
    log.add("10.0.0.1", "c1", 4, "latest", NOON)
    log.add("10.0.0.1", "c1", 3, "tile", NOON)
    assert len(log.records_of("c1", NOON)) == 5, "another client, view or way of looking is another access"


def test_files_are_begun_daily_and_go_when_they_are_too_old(tmp_path):
    log = AccessLog(tmp_path, keep=timedelta(days=3))
    for day in range(8):
        log.add("10.0.0.1", "c1", day, "latest", NOON + timedelta(days=day))
    assert [k["view"] for k in lines(tmp_path, log)] == [3, 4, 5, 6, 7]
    assert [k.view for k in log.records_of("c1", NOON + timedelta(days=7))] == [7, 6, 5, 4]
    assert [k.view for k in AccessLog(tmp_path, keep=timedelta(days=1)).records_of("c1", NOON + timedelta(days=7))] == [
        7,
        6,
    ]


def test_old_lines_go_also_where_nobody_looks(tmp_path):
    log = AccessLog(tmp_path, keep=timedelta(days=3))
    log.add("10.0.0.1", "c1", 0, "latest", NOON)
    log.flush()
    log.remove_old_files(NOON + timedelta(days=4))
    assert len(lines(tmp_path)) == 1
    log.remove_old_files(NOON + timedelta(days=4, seconds=1))
    assert lines(tmp_path) == []
    assert log.records_of("c1", NOON + timedelta(days=4)) == []
    log.add("10.0.0.1", "c1", 1, "latest", NOON + timedelta(days=5))
    assert [k["view"] for k in lines(tmp_path, log)] == [1]


def test_all_files_together_stay_below_their_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(access_log, "_FILE_BYTES", 1000)
    log = AccessLog(tmp_path, max_bytes=5000)
    for i in range(400):
        log.add("10.0.0.1", "c1", i, "latest", NOON + timedelta(seconds=i))
    log.flush()
    sizes = [f.stat().st_size for f in tmp_path.iterdir()]
    assert 3000 < sum(sizes) <= 5000
    assert max(sizes) < 1200
    assert lines(tmp_path)[-1]["view"] == 399


def test_memory_is_bounded(monkeypatch):
    monkeypatch.setattr(access_log, "_MAX_CLIENTS", 50)
    log = AccessLog()
    for i in range(11_000):
        log.add("10.0.0.1", "c1", i, "latest", NOON)
    assert len(log.records_of("c1", NOON)) == 10_000
    assert len(log._recorded_s) == 50


def test_broken_lines_and_foreign_files_are_left_out(tmp_path):
    first = AccessLog(tmp_path)
    first.add("10.0.0.1", "c1", 3, "latest", NOON)
    first.flush()
    (file,) = tmp_path.iterdir()
    with file.open("ab") as f:
        f.write(b'{"time":"2026-01-31T12:00:00","client":"","camera":"c1","view":0,"what":""}\n\xff\n{"time":"2026-01')
    (tmp_path / "looks-of-somebody.jsonl").write_text("what is this")
    log = AccessLog(tmp_path)
    assert len(log.records_of("c1", NOON)) == 1
    log.add("10.0.0.1", "c1", 3, "latest", NOON + timedelta(days=1))
    assert (tmp_path / "looks-of-somebody.jsonl").exists()


@pytest.mark.parametrize("place", ["a file is there", "nothing may be written"])
def test_a_disk_that_cant_be_written_stops_nobody_from_looking(tmp_path, place):
    (tmp_path / "looks").write_text("")
    log = AccessLog(tmp_path / "looks" if place == "a file is there" else tmp_path / "looks" / "deeper")
    log.add("10.0.0.1", "c1", 3, "latest", NOON)
    assert len(log.records_of("c1", NOON)) == 1
    with capture_logs() as said:
        log.flush()
    assert any("can't be written down" in line["event"] for line in said)


def test_what_a_full_disk_had_no_room_for_is_written_once_there_is_room(tmp_path, monkeypatch):
    monkeypatch.setattr("surveilnav.services.gateway.access_log._RETRY_S", 0.05)
    told, folder = [], tmp_path / "looks"
    folder.write_text("in the way")
    log = AccessLog(folder, report_problem=told.append)
    for view in range(3):
        log.add("10.0.0.1", "c1", view, "latest", NOON)
    log.flush()
    assert all("can't be written down" in why for why in told)
    folder.unlink()
    until(lambda: told[-1] == "")
    until(lambda: [r.view for r in AccessLog(folder).records_of("c1", NOON)] == [2, 1, 0])
