"""Which rows of a traffic report are published, how reports are put together, and what the kernel counts."""

from __future__ import annotations

import socket
from contextlib import suppress
from pathlib import Path

import msgspec
import pytest

from surveilnav.bus import traffic
from surveilnav.bus.traffic import ReportedRows, WireCounter
from surveilnav.bus.wire import decode, encode
from surveilnav.contract import schema_of
from surveilnav.errors import WireError
from surveilnav.messages import TrafficReport, TrafficRow
from tests.waiting import until


def row(key: str, n_bytes: int) -> TrafficRow:
    return TrafficRow(key, "offered", 1, n_bytes)


def report(*rows: TrafficRow, is_partial: bool = False) -> TrafficReport:
    return TrafficReport(stamp_ns=1, node="n", kind="camera", rows=list(rows), is_partial=is_partial)


def test_only_changed_rows_are_news_until_all_are_due_again():
    known = ReportedRows()
    rows = [row("a", 1), row("b", 2)]
    assert known.news(rows, 100.0) == (rows, False)
    assert known.news(rows, 101.0) == ([], True)
    assert known.news([row("a", 1), row("b", 3)], 102.0) == ([row("b", 3)], True)
    assert known.news([row("a", 1), row("b", 3)], 401.0) == ([row("a", 1), row("b", 3)], False)


def test_reports_are_put_together_whatever_is_missing_between_them():
    first = report(row("a", 1), row("b", 2))
    later = first.merged(report(row("b", 5), row("c", 1), is_partial=True))
    assert {r.key: r.n_bytes for r in later.rows} == {"a": 1, "b": 5, "c": 1}
    assert not later.is_partial
    invented = [report(*(row(f"{n}-{k}", 1) for k in range(20_000)), is_partial=True) for n in range(5)]
    for more in invented:
        later = later.merged(more)
        assert len(later.rows) <= 50_000
    part = report(row("a", 1), is_partial=True)
    assert part.merged(report(row("b", 1), is_partial=True)).is_partial
    assert later.merged(report(row("b", 1))).rows == [row("b", 1)], "the node was started again"


@pytest.mark.parametrize("n_bytes", [-1, 2**63, 2**64 - 1])
def test_numbers_that_nobody_can_hold_are_refused(n_bytes):
    for hostile in (
        report(row("a", n_bytes)),
        msgspec.structs.replace(report(), tier_bytes={"features": n_bytes}),
        msgspec.structs.replace(report(), unsent={"link": n_bytes}),
    ):
        with pytest.raises(WireError):
            decode(TrafficReport, encode(hostile), schema_of(TrafficReport))


@pytest.mark.skipif(
    not Path("/proc/self/fd").exists(), reason="the kernel's counts are read from /proc, which only Linux has"
)
def test_the_kernels_counts_are_those_of_connections_to_one_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        counter = WireCounter(server.getsockname()[1])
        assert counter.read() is None
        with socket.create_connection(server.getsockname()) as sender, server.accept()[0] as reader:
            counts = counter.read()
            assert (counts.sent, counts.queued, counts.segment_bytes > 500) == (0, 0, True)
            sender.sendall(b"x" * 5000)
            until(lambda: counter.read().acknowledged == counts.acknowledged + 5000)
            sender.setblocking(False)
            given = 0
            with suppress(BlockingIOError):
                while True:
                    given += sender.send(b"x" * 100_000)  # until the kernel takes no more, as nobody reads
            stuck = counter.read()
            assert stuck.acknowledged + stuck.queued == counts.acknowledged + 5000 + given
            with socket.create_connection(server.getsockname()) as second, server.accept()[0]:
                second.sendall(b"x" * 100)
                until(lambda: counter.read().acknowledged > stuck.acknowledged + 100)  # its handshake counts as a byte
            assert reader.recv(10)
        assert counter.read() is None


def locks_on(path):
    """The kinds of the locks on a file."""
    lines = Path("/proc/locks").read_text().splitlines()
    return {line.split()[1] for line in lines if f":{path.stat().st_ino} " in line}


@pytest.mark.skipif(not Path("/proc/locks").exists(), reason="locks are listed in /proc/locks, which only Linux has")
def test_a_file_that_took_over_the_number_of_a_socket_is_left_alone(tmp_path, monkeypatch):
    fcntl = pytest.importorskip("fcntl")
    path = tmp_path / "recording"
    with path.open("w") as file:
        monkeypatch.setattr(traffic, "_sockets", lambda: [file.fileno()])
        fcntl.flock(file, fcntl.LOCK_EX)
        fcntl.lockf(file, fcntl.LOCK_EX)
        assert locks_on(path) == {"FLOCK", "POSIX"}
        assert WireCounter(1).read() is None
        assert locks_on(path) == {"FLOCK", "POSIX"}, "closing a copy would release the process's own lock"
    with path.open("r") as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # a copy that is still open would hold the lock
