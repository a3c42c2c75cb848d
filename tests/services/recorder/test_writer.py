"""The writer: nobody waits for the disk, a full one ends a recording and nothing else, old files make room."""

from __future__ import annotations

import errno
import os
import threading
import time

import pytest
from mcap.records import Message

from surveilnav.bus import Refused
from surveilnav.services.recorder import writer as writer_module
from surveilnav.services.recorder.core.limits import Limits
from surveilnav.services.recorder.core.names import recording_id
from surveilnav.services.recorder.file import RecordingFile
from surveilnav.services.recorder.folder import RecordingFolder
from surveilnav.services.recorder.reading import BEGIN, END, RecordingError, records
from surveilnav.services.recorder.writer import RecordingWriter
from tests.waiting import until

ID, OTHER = recording_id(10**18, "m1"), recording_id(10**18 + 10**9, "m2")


@pytest.fixture
def writers():
    started = []

    def start(tools, folder, keep_s=None, **more):
        node = tools.node()
        more = {"max_days": 0} | more  # the tests' recordings are of 2001
        started.append(RecordingWriter(node, tools.settings(folder, **more), RecordingFolder(folder), keep_s))
        return node, started[-1]

    yield start
    for writer in started:
        writer.close()


def count(folder, id):
    """The number of messages in a recording so far; 0 also where its file is there and nothing of it was written yet."""
    try:
        return sum(isinstance(r, Message) for r in records(RecordingFolder(folder).path_of(id)))
    except RecordingError:
        return 0


def states(folder):
    return {r.mission: r.state for r in RecordingFolder(folder).recordings()}


def test_what_is_recorded_is_in_the_file_soon_and_after_the_end(tmp_path, tools, writers):
    node, writer = writers(tools, tmp_path, flush_s=0.05)
    writer.begin(ID, {"mission": "m1", "target": "tv"})
    assert writer.record([ID], tools.view_message(1))
    until(lambda: RecordingFolder(tmp_path).files() and RecordingFolder(tmp_path).path_of(ID).stat().st_size)
    until(lambda: count(tmp_path, ID) == 5)
    assert states(tmp_path) == {"m1": "recording"}
    writer.end(ID, {"number": "1"})
    until(lambda: states(tmp_path) == {"m1": "complete"})
    assert RecordingFolder(tmp_path).recordings()[0].target == "tv"
    assert node.said == ["recording", "recorded"]


def test_a_recorder_that_ends_leaves_files_that_say_so(tmp_path, tools, writers):
    _, writer = writers(tools, tmp_path)
    writer.begin(ID, {"mission": "m1"})
    writer.record([ID], tools.view_message(1))
    writer.close()
    assert states(tmp_path) == {"m1": "interrupted"}
    assert count(tmp_path, ID) == 5


def test_a_message_goes_into_the_files_that_it_is_for(tmp_path, tools, writers):
    _, writer = writers(tools, tmp_path)
    for id in (ID, OTHER):
        writer.begin(id, {})
    writer.record([ID, OTHER], tools.status_message(1))
    writer.record([OTHER], tools.status_message(2))
    writer.close()
    assert [count(tmp_path, id) for id in (ID, OTHER)] == [1, 2]


def test_a_slow_disk_drops_and_counts_and_nobody_waits(tmp_path, tools, writers, monkeypatch):
    go_on, stuck = threading.Event(), threading.Event()
    real = RecordingFile.write

    def slow(self, message):
        stuck.set()
        go_on.wait(30)
        real(self, message)

    monkeypatch.setattr(RecordingFile, "write", slow)
    node, writer = writers(tools, tmp_path, queue_mb=1)
    writer.begin(ID, {})
    writer.record([ID], tools.status_message(0))
    assert stuck.wait(20)
    recorded = [writer.record([ID], tools.status_message(i, "x" * 10_000)) for i in range(1, 201)]
    taken = sum(recorded)
    assert 90 < taken < 110, "a megabyte of messages of ten thousand bytes"
    assert recorded == [True] * taken + [False] * (200 - taken)
    assert writer.dropped == 200 - taken
    assert not writer.has_room
    assert "the disk is too slow" in node.said
    go_on.set()
    until(lambda: writer.has_room)
    assert writer.record([ID], tools.status_message(999))
    writer.close()
    assert count(tmp_path, ID) == taken + 2


def test_a_disk_that_fills_ends_the_recording_says_it_once_and_the_next_one_works(
    tmp_path, tools, writers, monkeypatch
):
    full = threading.Event()

    def refuse(fd, data, real=os.write):
        if full.is_set():
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(fd, data)

    monkeypatch.setattr("surveilnav.services.recorder.file.os.write", refuse)
    node, writer = writers(tools, tmp_path, flush_s=0.02)
    writer.begin(ID, {})
    for i in range(1, 4):
        writer.record([ID], tools.view_message(i))
    until(lambda: RecordingFolder(tmp_path).files() and count(tmp_path, ID) == 15)
    full.set()
    for i in range(4, 50):
        writer.record([ID], tools.view_message(i))
    until(lambda: ID in writer.failed)
    assert "No space left" in writer.problem
    assert "SURVEILNAV_RECORDER__FOLDER" in writer.problem
    assert writer.open == []
    full.clear()
    writer.record([ID], tools.view_message(50))  # its mission goes on
    assert writer.problem
    writer.end(ID, {"number": "50"})
    until(lambda: not writer.problem and not writer.failed)
    writer.begin(OTHER, {})
    writer.record([OTHER], tools.view_message(1))
    writer.end(OTHER, {"number": "1"})
    until(lambda: states(tmp_path).get("m2") == "complete")
    assert states(tmp_path) == {"m1": "interrupted", "m2": "complete"}
    assert count(tmp_path, ID) >= 15
    assert (writer.problem, node.said.count("recording stopped")) == ("", 1)


def test_others_need_what_is_left_of_the_disk(tmp_path, tools, writers, monkeypatch):
    free = 10 << 30
    monkeypatch.setattr(RecordingFolder, "free_bytes", lambda self: free)
    _, writer = writers(tools, tmp_path, flush_s=0.02)
    writer._settings.min_free_mb = 1000
    writer.begin(ID, {})
    writer.record([ID], tools.view_message(1))
    until(lambda: writer.open == [ID])
    free = 999 << 20
    until(lambda: ID in writer.failed)
    assert "999 MB are left" in writer.problem
    writer.begin(OTHER, {})
    until(lambda: OTHER in writer.failed)
    assert states(tmp_path) == {"m1": "interrupted"}


def test_files_of_earlier_runs_make_room_first(tmp_path, tools, writers):
    (tmp_path / f"{ID}.mcap").touch()  # of 2001
    _, writer = writers(tools, tmp_path, max_mb=3, max_days=30)
    until(lambda: not (tmp_path / f"{ID}.mcap").exists())  # it enforces the limits at its start
    now_ns = time.time_ns()
    ids = [recording_id(now_ns - (10 - i) * 10**9, "old") for i in range(4)]
    for id in ids:
        (tmp_path / f"{id}.mcap").write_bytes(bytes(1 << 20))
    (tmp_path / "notes.mcap").write_bytes(bytes(9 << 20))
    (tmp_path / "precious.txt").write_bytes(bytes(9 << 20))
    new = recording_id(now_ns, "m1")
    writer.begin(new, {})
    until(lambda: writer.open)
    assert len(RecordingFolder(tmp_path).files()) == 4, "one went before, though the new file has next to nothing yet"
    writer.end(new, {"number": "0"})
    # The file is complete a moment before the limits are enforced again.
    until(lambda: len(RecordingFolder(tmp_path).files()) <= 3)
    assert [f.id for f in RecordingFolder(tmp_path).files()] == [new, *reversed(ids[2:])]
    assert states(tmp_path)["m1"] == "complete"
    assert {p.name for p in tmp_path.glob("*")} >= {"notes.mcap", "precious.txt"}


@pytest.mark.parametrize(("max_days", "keep_s"), [(2.9, None), (30, 2.9 * 86_400), (2.9, 1e9), (0, 2.9 * 86_400)])
def test_old_files_go_though_there_is_room(tmp_path, tools, writers, max_days, keep_s):
    now_ns, day_ns = time.time_ns(), 86_400 * 10**9
    young, old = (tmp_path / f"{recording_id(now_ns - k * day_ns, 'm')}.mcap" for k in (2, 3))
    for path in (young, old):
        path.write_bytes(b"x")
    writers(tools, tmp_path, max_days=max_days, keep_s=keep_s)
    until(lambda: not old.exists())
    assert young.exists()


def test_a_bug_costs_one_message(tmp_path, tools, writers, monkeypatch):
    node, writer = writers(tools, tmp_path)
    writer.begin(ID, {})
    real = writer_module.FoxgloveConverter.convert
    monkeypatch.setattr(writer_module.FoxgloveConverter, "convert", lambda self, message: 1 / 0)
    writer.record([ID], tools.status_message(1))
    until(lambda: "a message can't be recorded" in node.said)
    monkeypatch.setattr(writer_module.FoxgloveConverter, "convert", real)
    writer.record([ID], tools.status_message(2))
    writer.close()
    assert count(tmp_path, ID) == 1


def test_the_folder_reads_and_deletes_recordings_and_nothing_else(tmp_path, tools, writers):
    _, writer = writers(tools, tmp_path)
    folder = RecordingFolder(tmp_path)
    writer.begin(ID, {"mission": "m1"})
    until(lambda: writer.open)
    with pytest.raises(Refused, match="being written"):
        folder.delete(ID)
    writer.end(ID, {"number": "0"})
    until(lambda: states(tmp_path) == {"m1": "complete"})
    content = (tmp_path / f"{ID}.mcap").read_bytes()
    assert folder.read(ID, 0, 10) == (content[:10], len(content))
    assert folder.read(ID, 5, 10**9) == (content[5:], len(content))
    assert folder.read(ID, len(content), 10) == (b"", len(content))
    assert folder.read(ID, -3, -1) == (b"", len(content))
    (tmp_path / "secret.mcap").write_bytes(b"s")
    for bad in ("secret", "../x", "", "x" * 500, OTHER):
        with pytest.raises(Refused, match="recording"):
            folder.read(bad, 0, 10)
        with pytest.raises(Refused, match="recording"):
            folder.delete(bad)
    folder.delete(ID)
    assert {p.name for p in tmp_path.iterdir()} == {"secret.mcap"}


def test_what_only_looks_like_a_recording_costs_no_other(tmp_path):
    (tmp_path / "20260101T000000000Z_m0.mcap").symlink_to(
        "20260101T000000000Z_m0.mcap"
    )  # leads nowhere, again and again
    folder = RecordingFolder(tmp_path)
    assert folder.files() == []
    (tmp_path / f"{ID}.mcap").mkdir()
    assert folder.enforce(Limits(1, 1), 2**62) == [], "a folder can't be deleted as a file"


def test_a_file_listed_between_its_last_byte_and_its_close_is_complete_afterwards(tmp_path):
    folder = RecordingFolder(tmp_path)
    file = RecordingFile(folder.path_of(ID))
    file.add_metadata(BEGIN, {"mission": "m1", "target": "tv"})
    file.add_metadata(END, {"number": "1"})
    file._writer.finish()
    assert [r.state for r in folder.recordings()] == ["recording"]
    file._raw.close()
    assert [r.state for r in folder.recordings()] == ["complete"]
