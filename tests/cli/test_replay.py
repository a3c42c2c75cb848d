"""What a replay refuses: files that are none, that lack something, or that somebody made up."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from typer.testing import CliRunner

from surveilnav import messages as m
from surveilnav.cli.main import app
from surveilnav.cli.replay.check import check, config_of
from surveilnav.contract import ROBOT_HALT, VIEW_LOG
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.snapshot import digest, freeze, pack
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.mcap_message import encode_bus_message
from surveilnav.services.recorder.reading import RecordingError
from surveilnav.services.recorder.recorded import RecordedMaps, RecordedMessage, RecordedStart, read_recording

SNAPSHOT = pack({"number": 0, "maps": freeze(JointMap(FusionConfig())), "processed": {}})
#: A frame of zstd that says it holds 3 GB.
BOMB = b"\x28\xb5\x2f\xfd\xe0" + (3 << 30).to_bytes(8, "little") + b"\x01\x00\x00"
CONFIG = FusionConfig().model_dump_json()
KEY = VIEW_LOG.key_for(building="b")


def file_of(path: Path, *parts: object) -> Path:
    """A file of those parts: (name, facts), (name, bytes), or (topic, encoding, schema, data)."""
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        for i, part in enumerate(parts):
            if len(part) == 4:
                topic, encoding, schema, data = part
                channel = writer.register_channel(topic, encoding, writer.register_schema(schema, "", b""))
                writer.add_message(channel, i, data, i)
            elif isinstance(part[1], bytes):
                writer.flush()
                writer.add_attachment(0, 0, part[0], "x", part[1])
            else:
                writer.flush()
                writer.add_metadata(*part)
        writer.finish()
    return path


def view_line(
    number: int = 1, header: bytes = b"\xff", payload: bytes = b"x", **more: object
) -> tuple[str, str, str, bytes]:
    view = m.LoggedView(stamp_ns=1, number=number, newest=number, source="robot/r", header=header, **more)
    line = encode_bus_message(BusMessage(VIEW_LOG, KEY, view, payload, 5))
    return line.topic, line.encoding, line.schema.name, line.data


MAPS = (("maps-0", {"config": CONFIG}), ("maps-0", SNAPSHOT))


def test_an_empty_recording_comes_to_what_it_began_with(tmp_path):
    nothing = digest(freeze(JointMap(FusionConfig())))
    path = file_of(tmp_path / "a.mcap", ("mission", {"mission": "m1"}), *MAPS, ("end", {"digest": nothing}))
    outcome = check(path)
    assert (outcome.same, outcome.replayed, outcome.views) == (True, nothing, 0)
    assert [type(t) for t in read_recording(path)][:2] == [RecordedStart, RecordedMaps]


@pytest.mark.parametrize(("end", "why"), [([("end", {"mission": "m1"})], "fusion didn't tell"), ([], "was cut off")])
def test_why_nothing_can_be_compared_is_said(tmp_path, end, why):
    outcome = check(file_of(tmp_path / "a.mcap", *MAPS, *end))
    assert why in outcome.in_words()
    assert outcome.as_dict()["ended"] is bool(end)


def test_what_is_damaged_is_said_and_all_else_replayed(tmp_path):
    halt = ROBOT_HALT.key_for(building="b", robot="r1")
    answer = msgspec.msgpack.encode(m.HaltReply(stamp_ns=1, robot="r1", halted=True))
    line = halt, "msgpack", "surveilnav.HaltReply/1.0", answer
    split = "note", {"x": "y"}  # metadata ends a chunk
    path = file_of(tmp_path / "a.mcap", *MAPS, line, line, line, split, line, split, line, ("end", {"digest": "0"}))
    assert check(path).missing == ""
    with path.open("rb") as stream:
        chunks = sorted(make_reader(stream).get_summary().chunk_indexes, key=lambda c: c.chunk_start_offset)
    data = bytearray(path.read_bytes())
    data[chunks[0].chunk_start_offset + chunks[0].chunk_length - 9] ^= 1
    path.write_bytes(data)
    assert len([t for t in read_recording(path) if isinstance(t, RecordedMessage)]) == 2
    outcome = check(path)
    assert outcome.ended
    assert "damaged: 1 part of the file" in outcome.in_words()
    assert "missing are messages of" in outcome.as_dict()["missing"]


@pytest.mark.parametrize(("claimed", "said"), [("", "nothing to compare with"), ("0" * 32, "NOT the same maps")])
def test_maps_that_aren_t_what_was_recorded_are_told_apart(tmp_path, claimed, said):
    outcome = check(file_of(tmp_path / "a.mcap", *MAPS, ("end", {"digest": claimed})))
    assert not outcome.same
    assert said in outcome.in_words()


@pytest.mark.parametrize(
    ("parts", "why"),
    [
        ([], "holds no mission"),
        ([("other", {"x": "y"})], "holds no mission"),
        ([("mission", {"mission": "m"})], "holds no maps"),
        ([("maps-0", {"config": CONFIG}), ("maps-0", b"junk")], "maps can't be read"),
        ([("maps-0", {"config": CONFIG}), ("maps-0", BOMB)], "no building's have"),
        ([("maps-0", {"config": CONFIG}), ("maps-0", pack({"other": 1}))], "maps can't be read"),
        ([("maps-0", {"config": CONFIG}), ("maps-0", pack([1, 2]))], "maps can't be read"),
        ([("maps-0", {"config": '{"map": 7}'}), ("maps-0", SNAPSHOT)], "settings of fusion"),
        ([("maps-x", {"config": CONFIG}), ("maps-x", SNAPSHOT)], "maps-NUMBER"),
        ([*MAPS, view_line()], "view 1 can't be read"),
        ([*MAPS, (KEY, "msgpack", "surveilnav.LoggedView/1.0", b"\xc1")], "can't be read"),
        ([*MAPS, (KEY, "msgpack", "surveilnav.LoggedView/1.0", msgspec.msgpack.encode([1, 2]))], "can't be read"),
    ],
)
def test_what_can_t_be_replayed_is_said(tmp_path, parts, why):
    path = file_of(tmp_path / "a.mcap", *parts)
    with pytest.raises(RecordingError, match=why):
        check(path)


def test_topics_of_others_are_passed_over(tmp_path):
    halt = ROBOT_HALT.key_for(building="b", robot="r1")
    parts = [
        ("/elsewhere", "json", "x", b"{}"),
        ("surveilnav/1/../../x", "msgpack", "surveilnav.RobotStatus/1.0", b"\xc1"),
        (KEY, "msgpack", "surveilnav.RobotStatus/1.0", b"\xc1"),
        (KEY, "protobuf", "surveilnav.LoggedView/1.0", b"\xc1"),
        (
            halt,
            "msgpack",
            "surveilnav.HaltReply/1.0",
            msgspec.msgpack.encode(m.HaltReply(stamp_ns=1, robot="r1", halted=True)),
        ),
    ]
    path = file_of(tmp_path / "a.mcap", *MAPS, *parts)
    assert [t.stream.name for t in read_recording(path) if isinstance(t, RecordedMessage)] == ["robot_halt"]
    assert check(path).views == 0


def test_the_settings_of_a_recording_are_those_of_its_fusion():
    config = FusionConfig().changed({"map": {"voxel_m": 0.07}})
    assert config_of(RecordedMaps(0, config.model_dump_json(), b"")) == config


@pytest.mark.parametrize(
    "arguments", [["README.md"], ["missing.mcap"], ["README.md", "--check"], ["missing.mcap", "--check"]]
)
def test_the_command_says_what_is_wrong_before_it_starts_anything(arguments):
    result = CliRunner().invoke(app, ["replay", *arguments])
    assert isinstance(result.exception, RecordingError)
