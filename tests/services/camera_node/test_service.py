"""The camera service over real Zenoh, with a camera made here."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from surveilnav.bus import Refused, Unanswered
from surveilnav.contract import CAMERA_FRAME, CAMERA_INFO, CAMERA_REQUEST, TRUTH
from surveilnav.messages import CameraRequest
from surveilnav.sensing.packing import decode_frame
from surveilnav.sensing.truth import truth_from_wire
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.simulated import serve_truth
from tests.waiting import patient, until

PLACE = {"floor": "0", "camera": "c1"}


@pytest.fixture
def client(make_node):
    return patient(make_node("test", "t", alive=False))


def listened(service, view):
    return until(lambda: service._sender._frames[view].matched)


def test_a_view_is_put_once_a_version_and_only_to_listeners(camera_node, client, make_camera):
    camera = make_camera()
    service = CameraService(camera_node, camera, CameraSettings())
    assert not service.step()
    assert camera.asked == [], "nobody listens: nothing is made"
    slot = client.latest(CAMERA_FRAME, **PLACE, view=3)
    listened(service, 3)
    assert service.step()
    frame = until(slot.poll)
    assert (frame.message.source, frame.message.view, frame.message.seq) == ("camera/c1", 3, 1)
    assert np.abs(decode_frame(frame.message, frame.payload).rgb.astype(int) - 99).max() <= 2
    assert not service.step()
    camera.versions[3] = 7
    assert service.step()
    again = until(slot.poll)
    assert again.message.seq == 2
    assert decode_frame(again.message, again.payload).rgb.mean() > 104
    assert camera.asked == [3, 3]


def test_what_is_asked_for_again_comes_again_without_being_made_again(camera_node, client, make_camera):
    camera = make_camera()
    service = CameraService(camera_node, camera, CameraSettings())
    slot = client.latest(CAMERA_FRAME, **PLACE, view=2)
    listened(service, 2)
    service.step()
    until(slot.poll)
    client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="resend", views=[2]), **PLACE)
    assert service.step()
    assert until(slot.poll).message.seq == 2
    assert camera.asked == [2]


def test_a_view_without_a_picture_yet_waits(camera_node, client, make_camera):
    camera = make_camera()
    camera.versions[2] = None
    service = CameraService(camera_node, camera, CameraSettings())
    slot = client.latest(CAMERA_FRAME, **PLACE, view=2)
    listened(service, 2)
    assert not service.step()
    thumbnail = CameraRequest(stamp_ns=1, action="thumbnail", views=[2])
    with pytest.raises(Refused, match="no picture yet") as refused:
        client.ask(CAMERA_REQUEST, thumbnail, **PLACE)
    assert refused.value.name == "busy"
    camera.versions[2] = 0
    assert service.step()
    assert until(slot.poll).message.seq == 1
    assert client.ask(CAMERA_REQUEST, thumbnail, **PLACE).payload.startswith(b"\xff\xd8")
    for asked_px, given_px in ((0, 480), (240, 240), (1, 64), (100_000, 480), (-5, 64)):
        request = CameraRequest(stamp_ns=1, action="thumbnail", views=[2], width_px=asked_px)
        picture = client.ask(CAMERA_REQUEST, request, **PLACE).payload
        assert cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR).shape[1] == given_px


def test_a_simulator_tells_who_asks_what_each_pixel_shows(camera_node, client, make_camera):
    camera = make_camera()
    serve_truth(camera_node, camera)
    told = client.ask(TRUTH, source="camera-c1", view=3, parameters={"seq": "7"})
    assert (told.message.source, told.message.view, told.message.seq) == ("camera/c1", 3, 7)
    truth = truth_from_wire(told.message, told.payload)
    assert (truth.ids == 1).all()
    assert truth.labels == {1: "bed"}
    assert np.allclose(truth.T_world_camera, camera.views[3].matrix())
    for view, seq in ((99, "1"), ("x", "1"), (3, ""), (3, "-1")):
        with pytest.raises(Refused, match="one of the camera's views") as refused:
            client.ask(TRUTH, source="camera-c1", view=view, parameters={"seq": seq})
        assert refused.value.name == "no_truth"


def test_a_camera_tells_no_truth_unless_a_simulator_has_it_do_so(camera_node, client, make_node, make_camera):
    service = CameraService(camera_node, make_camera(), CameraSettings())
    frames = client.latest(CAMERA_FRAME, **PLACE, view=3)
    listened(service, 3)
    service.step()
    seq = until(frames.poll).message.seq
    with pytest.raises(Unanswered, match="nobody is there"):
        make_node("test", "u", alive=False).ask(TRUTH, source="camera-c1", view=3, parameters={"seq": str(seq)})


def test_it_says_who_it_is_and_refuses_views_it_has_not(camera_node, client, make_camera):
    camera = make_camera()
    CameraService(camera_node, camera, CameraSettings())
    info = client.ask(CAMERA_INFO, **PLACE).message
    assert (info.camera, info.floor, info.position_m, info.mounting_offset_m) == ("c1", "0", (1.0, 2.0, 1.8), 1.8)
    assert [v.T_world_camera for v in info.views] == camera.views
    for views in ([13], []):
        with pytest.raises(Refused, match="0-12") as refused:
            client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="resend", views=views), **PLACE)
        assert refused.value.name == "bad_view"


def test_a_paused_camera_shows_nothing_and_then_everything_anew(camera_node, client, make_camera):
    camera = make_camera()
    service = CameraService(camera_node, camera, CameraSettings())
    infos = client.latest(CAMERA_INFO, **PLACE)
    slot = client.latest(CAMERA_FRAME, **PLACE, view=3)
    listened(service, 3)
    assert service.step()
    until(slot.poll)

    def ask(action, views=()):
        return client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action=action, views=list(views)), **PLACE)

    ask("pause")
    ask("pause")  # again is as good as once
    assert until(infos.poll).message.paused
    assert client.ask(CAMERA_INFO, **PLACE).message.paused
    camera.versions[3] = 9
    for action in ("thumbnail", "resend"):
        with pytest.raises(Refused, match="paused") as refused:
            ask(action, [3])
        assert refused.value.name == "paused"
    assert not service.step()
    assert camera.asked == [3], "nothing is made, whoever listens"
    ask("resume")
    assert not until(infos.poll).message.paused
    assert service.step()
    assert until(slot.poll).message.seq == 2
