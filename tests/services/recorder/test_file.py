"""The file: any MCAP reader has all of it; cut off anywhere, all up to the last whole chunk."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Attachment, Message, Metadata

from surveilnav.services.recorder import file as file_module
from surveilnav.services.recorder.core.foxglove import FoxgloveConverter
from surveilnav.services.recorder.file import RecordingFile
from surveilnav.services.recorder.folder import is_being_written
from surveilnav.services.recorder.reading import RecordingError, cameras_of_complete, records, target_of

MAPS = os.urandom(50_000)


def write(path, tools, *, end=True) -> RecordingFile:
    """A recording of thirty views and thirty statuses; after ``finish`` if ``end``."""
    file, converter = RecordingFile(path), FoxgloveConverter()
    file.add_metadata("mission", {"mission": "m1", "target": "tv"})
    file.add_attachment("maps-0", "application/zstd", MAPS, 1)
    for i in range(1, 31):
        for received in (tools.view_message(i), tools.status_message(i)):
            for message in converter.convert(received):
                file.write(message)
        if i % 5 == 0:
            file.flush()
    if end:
        file.add_metadata("end", {"number": "30"})
        file.finish()
    return file


def messages(path):
    return [r for r in records(path) if isinstance(r, Message)]


def test_an_mcap_reader_has_all_of_it(tmp_path, tools):
    path = tmp_path / "a.mcap"
    write(path, tools)
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        topics = {channel.topic for channel in summary.channels.values()}
        assert topics == {
            "surveilnav/1/b/view_log",
            "surveilnav/1/b/robot/r1/status",
            "/tf",
            "/robot/r1/picture",
            "/robot/r1/calibration",
            "/robot/r1/pose",
        }
        assert {s.encoding for s in summary.schemas.values()} == {"protobuf", "jsonschema"}
        assert len(list(reader.iter_messages())) == 30 * 6 == summary.statistics.message_count
        (attachment,) = reader.iter_attachments()
        assert (attachment.name, attachment.data) == ("maps-0", MAPS)
        assert next((r.name, r.metadata) for r in reader.iter_metadata()) == (
            "mission",
            {"mission": "m1", "target": "tv"},
        )
    assert cameras_of_complete(path) == []
    other = tmp_path / "b.mcap"
    file, converter = RecordingFile(other), FoxgloveConverter()
    for i, source in enumerate(("camera/c2", "robot/r1", "camera/c1"), 1):
        for message in converter.convert(tools.view_message(i, source)):
            file.write(message)
    file.add_metadata("end", {})
    file.finish()
    assert cameras_of_complete(other) == ["c1", "c2"]
    assert target_of(path) == "tv"


def test_a_file_that_isnt_closed_is_open_and_can_be_read_already(tmp_path, tools):
    path = tmp_path / "a.mcap"
    file = write(path, tools, end=False)
    assert is_being_written(path)
    assert cameras_of_complete(path) is None
    assert len(messages(path)) == 30 * 6
    file.abandon()
    assert not is_being_written(path)


def test_it_never_writes_over_another(tmp_path, tools):
    (tmp_path / "a.mcap").write_bytes(b"precious")
    with pytest.raises(FileExistsError):
        RecordingFile(tmp_path / "a.mcap")


_WRITER = """
import sys, time
from pathlib import Path
sys.path.insert(0, {root!r})
from surveilnav.services.recorder.core.mcap_message import McapMessage, Schema
from surveilnav.services.recorder.file import RecordingFile
file = RecordingFile(Path({path!r}))
file.add_metadata("mission", {{"target": "tv"}})
for i in range(10**9):
    file.write(McapMessage("/n", "json", Schema("n", "jsonschema", b"{{}}"), b'{{"n": %d}}' % i + b" " * 1000, i, i))
    if i % 10 == 9:
        file.flush()
        print(i, flush=True)
"""


def test_kill_9_in_the_midst_of_writing_loses_what_came_after_the_last_flush_alone(tmp_path):
    path, root = tmp_path / "a.mcap", os.getcwd()
    process = subprocess.Popen(
        [sys.executable, "-c", _WRITER.format(root=root, path=str(path))], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    for _ in range(20):
        said = int(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    rest = process.stdout.read().split()
    process.wait()
    last = int(rest[-1]) if rest else said
    numbers = [m.log_time for m in messages(path)]
    assert numbers == list(range(len(numbers)))
    assert len(numbers) > last
    assert not is_being_written(path)
    assert cameras_of_complete(path) is None
    assert target_of(path) == "tv"


@pytest.fixture(scope="module")
def whole(tmp_path_factory, tools):
    path = tmp_path_factory.mktemp("whole") / "a.mcap"
    write(path, tools)
    return path


def summary_of(path):
    kinds = {
        Message: lambda r: (r.channel_id, r.log_time, r.data),
        Attachment: lambda r: r.data,
        Metadata: lambda r: r.name,
    }
    return [kinds[type(r)](r) for r in records(path) if type(r) in kinds]


@given(st.data())
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
def test_cut_off_anywhere_it_is_read_so_far(whole, tmp_path, data):
    everything, all_of_it = whole.read_bytes(), summary_of(whole)
    path = tmp_path / "cut.mcap"
    path.write_bytes(everything[: data.draw(st.integers(8, len(everything) - 1))])
    found = summary_of(path)
    assert found == all_of_it[: len(found)]
    assert cameras_of_complete(path) is None


@given(st.data())
@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
def test_a_damaged_byte_makes_no_other_messages(whole, tmp_path, data):
    everything, all_of_it = bytearray(whole.read_bytes()), summary_of(whole)
    at = data.draw(st.integers(8, len(everything) - 1))
    everything[at] ^= data.draw(st.integers(1, 255))
    path = tmp_path / "damaged.mcap"
    path.write_bytes(everything)
    seen = [m for m in summary_of(path) if isinstance(m, tuple)]
    assert set(seen) <= {m for m in all_of_it if isinstance(m, tuple)}
    cameras_of_complete(path)
    target_of(path)


@pytest.mark.parametrize(
    "content", [b"", b"\x89MCA", b"PK\x03\x04", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + b"\xff" * 100]
)
def test_what_is_no_recording_is_refused_or_empty(tmp_path, content):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    if content.startswith(b"\x89MCAP"):
        assert list(records(path)) == []
    else:
        with pytest.raises(RecordingError, match="expected a recording"):
            list(records(path))
    with pytest.raises(RecordingError, match="can't be read"):
        list(records(tmp_path / "missing.mcap"))


def test_a_disk_that_fills_leaves_whole_chunks(tmp_path, tools, monkeypatch):
    path, room = tmp_path / "a.mcap", 60_000

    def write_some(fd, data, real=os.write):
        nonlocal room
        n = min(len(data), room)
        if n == 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        room -= n
        return real(fd, data[:n])

    monkeypatch.setattr(file_module.os, "write", write_some)
    file, converter, written = RecordingFile(path), FoxgloveConverter(), []

    def write_until_full() -> None:
        for i in range(1, 1000):
            for message in converter.convert(tools.view_message(i)):
                file.write(message)
            file.flush()
            written.append(i)

    with pytest.raises(OSError, match="No space"):
        write_until_full()
    file.abandon()
    assert 0 < len(messages(path)) == len(written) * 5
    assert path.stat().st_size < 60_000
    assert not is_being_written(path)
