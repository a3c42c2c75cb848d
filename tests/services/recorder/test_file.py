"""The file: any MCAP reader has all of it; cut off anywhere, all up to the last whole chunk."""

from __future__ import annotations

import errno
import os
import random
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
from surveilnav.services.recorder.intact import Damage, _read_index
from surveilnav.services.recorder.reading import RecordingError, cameras_of_complete, records, target_of
from surveilnav.services.recorder.recorded import RecordedDamage, RecordedEnd, RecordedMessage, read_recording

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


def flipped(whole, path, seed: int, n: int, lowest: int = 8) -> None:
    """A copy of a file with ``n`` bits flipped at random, from byte ``lowest`` on."""
    data, chance = bytearray(whole.read_bytes()), random.Random(seed)
    for _ in range(n):
        data[chance.randrange(lowest, len(data))] ^= 1 << chance.randrange(8)
    path.write_bytes(data)


@pytest.mark.parametrize("seed", range(40))
def test_with_bits_flipped_at_random_all_whole_chunks_are_read_and_the_rest_is_told_of(whole, tmp_path, seed):
    """What is read and what is told to be damaged are together all of it; no message is made up."""
    path, everything = tmp_path / "a.mcap", summary_of(whole)
    flipped(whole, path, seed, 1 + seed % 5)
    found, damages = summary_of(path), [r for r in records(path) if isinstance(r, Damage)]
    real = [r for r in everything if isinstance(r, tuple)]
    messages = [r for r in found if isinstance(r, tuple)]
    assert set(messages) <= set(real)
    assert messages == [r for r in real if r in set(messages)], "in their order"
    with whole.open("rb") as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    has_index = _read_index(path.open("rb")).records != {}
    if has_index:
        lost = {
            (c.message_start_time, c.message_end_time)
            for c in chunks
            if c.chunk_start_offset in {d.offset for d in damages}
        }
        expected = [r for r in real if not any(begin <= r[1] <= end for begin, end in lost)]
        assert [r for r in messages if r in expected] == expected, "a whole chunk isn't read"
        assert lost <= {(d.start_ns, d.end_ns) for d in damages}
    assert bool(damages) or len(messages) == len(real) or not has_index


def test_a_damaged_chunk_costs_that_chunk(whole, tmp_path):
    path, everything = tmp_path / "a.mcap", summary_of(whole)
    with whole.open("rb") as stream:
        chunks = sorted(make_reader(stream).get_summary().chunk_indexes, key=lambda c: c.chunk_start_offset)
    assert len(chunks) == 6
    data = bytearray(whole.read_bytes())
    for chunk in (chunks[0], chunks[3]):
        data[chunk.chunk_start_offset + 60 + chunk.compressed_size // 2] ^= 4
    data[chunks[4].chunk_start_offset + 3] ^= 64  # its length
    path.write_bytes(data)
    damages = [r for r in records(path) if isinstance(r, Damage)]
    assert [d.offset for d in damages] == [chunks[0].chunk_start_offset, chunks[3].chunk_start_offset]
    found = [r for r in summary_of(path) if isinstance(r, tuple)]
    assert 0 < len(found) < len([r for r in everything if isinstance(r, tuple)])
    assert {r[1] for r in found} >= {chunks[k].message_end_time for k in (1, 2, 4, 5)}
    heard = [t for t in read_recording(path) if isinstance(t, RecordedMessage)]
    assert heard, "the channels that the first chunk declared are known from the index"
    assert sum(isinstance(t, RecordedDamage) for t in read_recording(path)) == 2
    assert isinstance(list(read_recording(path))[-1], RecordedEnd)


def test_damaged_maps_are_no_maps(whole, tmp_path):
    path, data = tmp_path / "a.mcap", bytearray(whole.read_bytes())
    data[data.index(MAPS[:64]) + 20_000] ^= 1
    path.write_bytes(data)
    assert not [r for r in records(path) if isinstance(r, Attachment)]
    assert [r.n_bytes > 50_000 for r in records(path) if isinstance(r, Damage)] == [True]


def test_of_a_file_that_was_cut_off_a_damaged_chunk_is_skipped_by_its_length(whole, tmp_path):
    path, data = tmp_path / "a.mcap", bytearray(whole.read_bytes())
    with whole.open("rb") as stream:
        chunks = sorted(make_reader(stream).get_summary().chunk_indexes, key=lambda c: c.chunk_start_offset)
    data[chunks[2].chunk_start_offset + 60 + chunks[2].compressed_size // 2] ^= 4
    path.write_bytes(data[: chunks[5].chunk_start_offset + 100])
    times = {r[1] for r in summary_of(path) if isinstance(r, tuple)}
    assert times >= {chunks[k].message_end_time for k in (0, 1, 3, 4)}
    assert chunks[2].message_end_time not in times
