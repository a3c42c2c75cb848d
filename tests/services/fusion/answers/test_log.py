"""What fusion tells of its log and its maps: enough to make the same maps again, from any point of a run."""

from __future__ import annotations

import threading

import msgspec
import pytest

from surveilnav.bus import Refused, Request
from surveilnav.geometry import Pose
from surveilnav.messages import FrameHeader, InferReply
from surveilnav.sensing.packing import decode_frame, encode_rgbd
from surveilnav.sensing.replies import perception_from_wire, perception_to_wire
from surveilnav.sensing.views import DetectedObject
from surveilnav.services.fusion.answers.log import LogAnswers
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.snapshot import digest, freeze, thaw, unpack
from surveilnav.services.fusion.core.views.validation import ViewError
from surveilnav.services.fusion.map_log.log import MapLog
from surveilnav.services.fusion.map_log.recovery import perceived_from_entry
from surveilnav.services.fusion.map_log.store import Entry
from surveilnav.services.fusion.perceived import PerceivedView


class Silent:
    """A node that nobody listens to."""

    def __init__(self) -> None:
        self.stopping, self.log = threading.Event(), self

    def __getattr__(self, name: str):
        return lambda *_, **__: None


def view(tools, world, seq: int, x: float | None = None) -> PerceivedView:
    v = world.view(1.0 + 0.1 * seq if x is None else x, 2, 0.05 * seq, -0.2, seq=seq)
    payload, image, depth = encode_rgbd(v.rgb, v.depth_m, depth_range_m=(0.1, 10.0))
    header = FrameHeader(
        stamp_ns=10**9 * seq,
        source="robot/r",
        view=0,
        seq=seq,
        floor="0",
        camera=v.camera,
        depth_range_m=(0.1, 10.0),
        T_world_camera=Pose.from_matrix(v.T_world_camera),
        mounting_offset_m=v.mounting_offset_m,
        image=image,
        depth=depth,
    )
    chair = DetectedObject("couch", 0.6, (20.0, 40.0, 120.0, 110.0), None, tools.unit(seq % 3))
    detections, embedding = perception_to_wire(tools.seen(chair, image=tools.unit(seq % 4)))
    reply = InferReply(
        stamp_ns=1,
        worker="w",
        backend="b",
        source="robot/r",
        view=0,
        seq=seq,
        detections=detections,
        image_embedding=embedding,
    )
    return PerceivedView(
        ("robot/r", 0),
        header,
        decode_frame(header, payload),
        perception_from_wire(reply, v.camera),
        payload,
        msgspec.msgpack.encode(reply),
        bytes([seq]) * 16,
    )


def request(**parameters: object) -> Request:
    return Request({}, {k: str(v) for k, v in parameters.items()}, None, b"", 0)


@pytest.fixture
def fusion(tmp_path, tools):
    """(history, take a view with that number) of a fusion with a store."""
    world = tools.world(boxes={"sofa": ((3.0, 1.0, 0.0), (4.6, 1.9, 0.8))})
    maps = BuildingMaps(FusionConfig())
    log = MapLog(Silent(), FusionSettings(store=str(tmp_path / "fusion.sqlite"), snapshot_views=1000), maps)
    yield (
        LogAnswers("fusion", maps, log),
        lambda *seqs, **more: [log.integrate([view(tools, world, s, **more)]) for s in seqs],
    )
    log.close()


def whole_snapshot(history):
    """(header, bytes) of all pieces."""
    part = history.snapshot(request())
    header, data = part.message, part.payload
    while len(data) < header.n_bytes:
        part = history.snapshot(request(number=header.number, offset=len(data)))
        assert part.payload
        data += part.payload
    return header, data


def taken_again(joint: JointMap, history, after: int) -> JointMap:
    """The maps after all views of the log past a number."""
    while (answer := history.view(request(after=after))).message.number:
        v = answer.message
        assert v.number == after + 1
        after = v.number
        entry = Entry(v.source, v.view, v.header, answer.payload, v.reply, v.digest, v.fault)
        perceived = perceived_from_entry(entry)
        try:
            if perceived.view is not None:
                joint.accept(perceived.view, perceived.perception)
        except ViewError:
            continue
    assert after == answer.message.newest
    return joint


@pytest.mark.parametrize("begin", [0, 3])
@pytest.mark.parametrize("piece", [8 << 20, 1000])
def test_a_snapshot_and_the_views_after_it_make_the_same_maps(fusion, begin, piece, monkeypatch):
    monkeypatch.setattr("surveilnav.services.fusion.answers.log._PIECE_BYTES", piece)
    history, take = fusion
    take(*range(1, begin + 1))
    header, data = whole_snapshot(history)
    assert header.number == begin
    joint = thaw(unpack(data)["maps"], FusionConfig.model_validate_json(header.config))
    assert digest(freeze(joint)) == header.digest
    take(*range(begin + 1, 7))
    take(7, x=5.5)  # a pose that can't be: refused then, and again
    take(8)
    told = history.snapshot(request(only="digest")).message
    assert told.number == 8
    assert told.digest != header.digest
    assert digest(freeze(taken_again(joint, history, header.number))) == told.digest


def test_the_log_tells_one_view_at_a_time_and_then_that_there_is_no_more(fusion):
    history, take = fusion
    assert (history.view(request()).message.number, history.view(request()).message.newest) == (0, 0)
    take(1, 2)
    assert [history.view(request(after=n)).message.number for n in range(3)] == [1, 2, 0]
    assert history.view(request(after=99)).message.newest == 2


def test_a_view_that_is_logged_and_not_yet_taken_isnt_told(fusion):
    history, take = fusion
    take(1, 2)
    history._maps.number = 1
    assert history.view(request(after=1)).message.number == 0


def test_pieces_of_maps_that_aren_t_kept_any_more_are_refused(fusion, monkeypatch):
    monkeypatch.setattr("surveilnav.services.fusion.answers.log._PIECE_BYTES", 100)
    history, take = fusion
    take(1)
    first = history.snapshot(request()).message
    take(2)
    history.snapshot(request())  # somebody else's
    with pytest.raises(Refused, match="from offset 0 again"):
        history.snapshot(request(number=first.number, offset=100))


@pytest.mark.parametrize("said", ["-1", "1.5", "x", "", "9" * 17, "١"])
def test_numbers_that_are_none(fusion, said):
    history, _ = fusion
    for ask in (lambda: history.view(request(after=said)), lambda: history.snapshot(request(offset=said))):
        with pytest.raises(Refused, match="from 0 on"):
            ask()


def test_without_a_store_there_is_no_log_but_maps(tools):
    maps = BuildingMaps(FusionConfig())
    log = MapLog(Silent(), FusionSettings(store=""), maps)
    history = LogAnswers("fusion", maps, log)
    with pytest.raises(Refused, match="SURVEILNAV_FUSION__STORE"):
        history.view(request())
    assert history.snapshot(request()).message.n_bytes > 0
