"""What is written of a message: itself, to the byte, and what Foxglove draws of it."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Grid_pb2 import Grid as FoxgloveGrid
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PointCloud_pb2 import PointCloud
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from surveilnav import contract
from surveilnav import messages as m
from surveilnav.contract import MAP_LAYER, MISSION_PLAN, MISSION_STATUS, VIEW_LOG
from surveilnav.geometry import Grid, Pinhole, Pose
from surveilnav.sensing.packing import pack_array
from surveilnav.services.recorder.core.bus_message import BusMessage
from surveilnav.services.recorder.core.foxglove import FoxgloveConverter
from surveilnav.services.recorder.core.mcap_message import decode_bus_message, stream_of_topic

GRID = Grid(-1.0, -2.0, 0.5, 3, 4)
UPRIGHT = Pose((1.0, 2.0, 2.2), (0.0, 0.0, 0.0, 1.0))


def received(stream, message, payload=b"", **ids):
    return BusMessage(stream, stream.key_for(building="b", **ids), message, payload, 77)


def drawn(kind, messages, topic):
    """The one message of a topic, as its schema reads it."""
    (message,) = [m for m in messages if m.topic == topic]
    assert (message.encoding, message.schema.name) == ("protobuf", kind.DESCRIPTOR.full_name)
    return kind.FromString(message.data)


@pytest.mark.parametrize("source", ["robot/r1", "camera/c1"])
def test_a_view_is_written_as_it_came_and_as_a_picture(tools, source):
    view, payload = tools.logged(3, source)
    messages = FoxgloveConverter().convert(received(VIEW_LOG, view, payload))
    assert decode_bus_message(VIEW_LOG, messages[0].data) == (view, payload)
    assert stream_of_topic(messages[0].schema.name, messages[0].topic) is VIEW_LOG
    topic = "/robot/r1/picture" if source == "robot/r1" else "/camera/c1/view_0/picture"
    image = drawn(CompressedImage, messages, topic)
    assert image.format == "jpeg"
    assert tools.jpeg_of(image.data).shape == (24, 32, 3)
    assert (image.timestamp.seconds, image.timestamp.nanos) == (3, 0)
    poses = [message for message in messages if message.topic.endswith("/pose")]
    assert len(poses) == (source == "robot/r1")
    if poses:
        pose = PoseInFrame.FromString(poses[0].data)
        assert (pose.frame_id, pose.pose.position.x, pose.pose.position.y) == ("world", 1.0, 2.0)


def test_a_view_that_was_of_no_use_is_written_all_the_same():
    view = m.LoggedView(stamp_ns=1, number=4, newest=4, source="camera/c1", fault="unreadable: x")
    messages = FoxgloveConverter().convert(received(VIEW_LOG, view))
    assert [decode_bus_message(VIEW_LOG, message.data) for message in messages] == [(view, b"")]


def test_a_header_that_cant_be_read_costs_only_the_picture(tools):
    view, payload = tools.logged(3)
    bad = msgspec.structs.replace(view, header=b"\xff")
    assert [message.schema.name for message in FoxgloveConverter().convert(received(VIEW_LOG, bad, payload))] == [
        "surveilnav.LoggedView/1.0"
    ]


def layer(name, cells, **more):
    header = m.LayerHeader(
        stamp_ns=5, floor="0", layer=name, revision=1, grid=GRID, dtype=str(cells.dtype), shape=cells.shape, **more
    )
    return received(MAP_LAYER, header, pack_array(cells), floor="0", layer=name)


@pytest.mark.parametrize(("name", "dtype", "stride"), [("occupancy", np.uint8, 1), ("value", np.float32, 4)])
def test_a_layer_lies_on_its_floor(name, dtype, stride):
    converter = FoxgloveConverter(floor_z_m={"0": 2.8})
    cells = np.arange(12, dtype=dtype).reshape(3, 4) % 2
    grid = drawn(FoxgloveGrid, converter.convert(layer(name, cells)), f"/map/0/{name}")
    assert (grid.pose.position.x, grid.pose.position.y, grid.pose.position.z) == (-1.0, -2.0, 2.8)
    assert (grid.column_count, grid.row_stride, grid.cell_stride, grid.cell_size.x) == (4, 4 * stride, stride, 0.5)
    assert (np.frombuffer(grid.data, dtype).reshape(3, 4) == cells).all()


@pytest.mark.parametrize("n", [0, 5, 250_000])
def test_a_cloud_has_a_bounded_number_of_points(n):
    points = np.random.default_rng(0).random((n, 6), np.float32)
    cloud = drawn(PointCloud, FoxgloveConverter().convert(layer("cloud", points)), "/map/0/cloud")
    assert cloud.point_stride == 16
    drawn_points = len(cloud.data) // 16
    assert drawn_points == n if n < 100_000 else 50_000 < drawn_points <= 100_000
    if n:
        assert np.frombuffer(cloud.data[:12], "<f4") == pytest.approx(points[0, :3])
        assert cloud.data[12] == int(points[0, 3] * 255)


def test_a_layer_that_isnt_what_its_header_says_is_left_out():
    wrong = layer("occupancy", np.zeros((3, 4), np.uint8))
    assert FoxgloveConverter().convert(BusMessage(MAP_LAYER, wrong.key, wrong.message, b"junk", 1)) == []


def info(name):
    views = [m.CameraViewInfo(0, UPRIGHT), m.CameraViewInfo(1, UPRIGHT)]
    return m.CameraInfo(
        stamp_ns=1,
        camera=name,
        floor="0",
        position_m=(1.0, 2.0, 2.2),
        mounting_offset_m=2.2,
        views=views,
        intrinsics=Pinhole.from_hfov(64, 64, 1.7),
    )


def revision(*cameras, stamp_ns=1):
    return m.Revision(
        stamp_ns=stamp_ns,
        floor="0",
        revision=1,
        floor_z_m=0.3,
        robots={},
        pending_views=0,
        cameras=[m.CameraUse(c, 1, 2) for c in cameras],
    )


def test_cameras_are_drawn_when_they_or_their_use_change():
    converter = FoxgloveConverter()

    def scenes(message):
        stream = contract.CAMERA_INFO if isinstance(message, m.CameraInfo) else contract.MAP_REVISION
        ids = {"camera": message.camera} if stream is contract.CAMERA_INFO else {}
        messages = converter.convert(received(stream, message, floor="0", **ids))
        return [SceneUpdate.FromString(message.data) for message in messages if message.topic == "/cameras"]

    assert scenes(info("c1")) == scenes(info("c2")) == []
    (first,) = scenes(revision())
    assert [e.id for e in first.entities] == ["camera_c1", "camera_c2"]
    assert scenes(revision()) == []
    (second,) = scenes(revision("c2"))
    assert [e.cubes[0].color != first.entities[0].cubes[0].color for e in second.entities] == [False, True]
    assert [len(e.lines) for e in second.entities] == [2, 2]
    assert len(scenes(revision())) == 1
    for i in range(1100):
        scenes(info(f"x{i}"))
    assert len(converter.infos) == 1000


def record(id, status):
    return m.ObjectRecord(
        id=id,
        floor="0",
        label="couch",
        status=status,
        confidence=0.8,
        confidence_robot=0.8,
        confidence_surveillance=0.0,
        label_robot="couch",
        label_surveillance="",
        n_detections=1,
        n_points=9,
        center_m=(1.0, 2.0, 0.4),
        size_m=(2.0, 1.0, 0.0),
        first_seen_ns=1,
        last_seen_ns=2,
        sources=["robot/r1"],
        reason="seen",
    )


def test_objects_are_boxes_with_words():
    objects = m.ObjectList(stamp_ns=1, floor="0", revision=3, objects=[record(7, "confirmed"), record(8, "rejected")])
    scene = drawn(
        SceneUpdate, FoxgloveConverter().convert(received(contract.OBJECTS, objects, floor="0")), "/objects/0"
    )
    assert len(scene.deletions) == 1
    assert [(e.id, e.texts[0].text) for e in scene.entities] == [
        ("object_0_7", "couch 0.80"),
        ("object_0_8", "couch 0.80"),
    ]
    assert scene.entities[0].cubes[0].size.z > 0, "what is flat is seen, too"
    assert scene.entities[0].cubes[0].color != scene.entities[1].cubes[0].color


def plan(why="to a frontier", action="move_forward"):
    ahead = m.Candidate("frontier", 4.0, 2.0, 0.41, True)
    return m.Plan(
        stamp_ns=9,
        mission="m1",
        robot="r1",
        floor="0",
        step=1,
        seq=1,
        action=action,
        waypoint=ahead,
        why=why,
        path_m=[(1.0, 2.0), (4.0, 2.0)],
        candidates=[ahead, m.Candidate("candidate", 6.0, 1.0, 0.02)],
    )


def test_a_plan_is_drawn_on_its_floor_and_logged_once():
    converter = FoxgloveConverter(floor_z_m={"0": 2.8})
    messages = converter.convert(received(MISSION_PLAN, plan(), mission="m1"))
    entity = drawn(SceneUpdate, messages, "/plan").entities[0]
    assert [(p.x, p.y, round(p.z, 2)) for p in entity.lines[0].points] == [(1.0, 2.0, 2.85), (4.0, 2.0, 2.85)]
    assert len(entity.spheres) == 3
    assert drawn(Log, messages, "/decisions").message == "move_forward: to a frontier"
    again = converter.convert(received(MISSION_PLAN, plan(), mission="m1"))
    assert [message.topic for message in again if message.topic == "/decisions"] == []


def test_a_failure_is_an_error_in_the_log():
    status = m.MissionStatus(
        stamp_ns=1,
        mission="m1",
        target="tv",
        robot="r1",
        state="failed",
        phase="finished",
        step=3,
        max_steps=9,
        path_m=1.0,
        message="no way leads there",
    )
    log = drawn(Log, FoxgloveConverter().convert(received(MISSION_STATUS, status, mission="m1")), "/decisions")
    assert (log.level, log.name, log.message) == (Log.ERROR, "m1", "failed: no way leads there")
