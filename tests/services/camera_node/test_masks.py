"""No pixel of a mask zone survives in anything that a camera node says.

Two buildings differ in nothing but what the zones hide. Everything a camera says of the one must then be what it says of
the other, byte by byte: frames, depth, thumbnails, truth, what its own perception sees.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.contract import CAMERA_FRAME, CAMERA_REQUEST, CAMERA_SUMMARY, TRUTH
from surveilnav.errors import ConfigError
from surveilnav.geometry.polygon import pixels_in
from surveilnav.messages import CameraRequest, ModelIds
from surveilnav.sensing.packing import decode_frame
from surveilnav.sensing.truth import truth_to_wire
from surveilnav.sensing.views import DetectedObject, TrueInstances, ViewPerception
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.edge_perception import EdgePerception
from surveilnav.services.camera_node.frames import FrameEncoder
from surveilnav.services.camera_node.own_perception import OwnPerception
from surveilnav.services.camera_node.service import CameraService
from surveilnav.services.camera_node.simulated import serve_truth
from surveilnav.services.camera_node.sources.masked import MaskedSource, hide_mask_zones
from surveilnav.services.camera_node.sources.source import Picture
from tests.services.camera_node.conftest import SIDE, Camera
from tests.waiting import patient, until

PLACE = {"floor": "0", "camera": "c1"}
ZONE = ((0.2, 0.3), (0.7, 0.35), (0.5, 0.8))
NO_CACHE = CameraSettings(jpeg_quality=90, disk_cache_mb=0)


class Building(Camera):
    """Noise everywhere, the same for every ``secret`` but within ``hidden`` (height, width)."""

    def __init__(self, hidden, secret):
        super().__init__()
        self._hidden, self._secret = hidden, secret

    def latest(self, view):
        plain, secret = np.random.default_rng(view), np.random.default_rng([view, self._secret])
        shape = (SIDE, SIDE)
        rgb, depth, ids = (
            np.where(self._hidden[(...,) + (None,) * (len(size) - 2)], draw(secret, size), draw(plain, size))
            for size, draw in (
                ((*shape, 3), lambda rng, size: rng.integers(0, 255, size, np.uint8)),
                (shape, lambda rng, size: rng.uniform(0.5, 9.0, size).astype(np.float32)),
                (shape, lambda rng, size: rng.integers(0, 3, size, np.uint16)),
            )
        )
        return Picture(
            self.versions[view], rgb, depth, TrueInstances(ids, {1: "bed", 2: "tv"}, self.views[view].matrix())
        )


def pair(polygons):
    """Two buildings that differ within the polygons alone."""
    hidden = pixels_in(polygons, SIDE, SIDE)
    return Building(hidden, 1), Building(hidden, 2)


UNIT = st.floats(0, 1)
POLYGONS = st.lists(st.tuples(*[st.tuples(UNIT, UNIT)] * 3), min_size=1, max_size=3)


@settings(max_examples=30)
@given(POLYGONS)
def test_bytes_dont_depend_on_what_is_hidden(polygons):
    said = []
    for building in pair(polygons):
        source = MaskedSource(building, {3: polygons})
        encoded = FrameEncoder(source, NO_CACHE)
        truth, payload = truth_to_wire(source.latest(3).truth, source="camera/c1", view=3, seq=1, stamp_ns=1)
        said.append((encoded.newest(3).payload, encoded.thumbnail(3, 48), bytes(payload), truth))
    assert said[0] == said[1]


def test_the_two_buildings_do_differ():
    """Without the mask the bytes are others: the test above can fail."""
    one, other = (FrameEncoder(b, NO_CACHE) for b in pair([ZONE]))
    assert one.newest(3).payload != other.newest(3).payload
    assert one.thumbnail(3, 48) != other.thumbnail(3, 48)


@pytest.fixture
def camera_settings(tmp_path):
    path = tmp_path / "masks.yaml"
    path.write_text(json.dumps({"c1": {"all": [ZONE]}}))
    return CameraSettings(masks=str(path), perception="oracle", look_period_s=0.01)


class Gossip:
    """A backend that tells all it sees: every pixel changes what it says."""

    name, why, embedding_dim, needs_truth, models = "gossip", "a test", 81, True, ModelIds()

    def perceive(self, rgb, depth_m, camera, *, prompts=(), truth=None, key=()):
        numbers = [rgb.astype(int).sum(), np.nansum(depth_m), (truth.ids == 1).sum(), (truth.ids == 2).sum()]
        box = (0.0, 0.0, 9.0, 9.0)
        found = tuple(
            DetectedObject(f"{i}", float(n % 997) / 997, box, None, np.zeros(81, np.float32))
            for i, n in enumerate(numbers)
        )
        return ViewPerception(self.name, found, np.zeros(81, np.float32))


@pytest.mark.parametrize("secret", [1, 2])
def test_what_a_camera_puts_holds_nothing_of_its_zones(camera_node, make_node, camera_settings, secret):
    """Over the bus: frame, depth, truth and thumbnail of a view, and the summary of its own perception."""
    client = patient(make_node("test", "t", alive=False))
    building = pair([ZONE])[secret - 1]
    hidden = pixels_in([ZONE], SIDE, SIDE)
    service = CameraService(camera_node, building, camera_settings)
    serve_truth(camera_node, hide_mask_zones(building, camera_settings))
    frames = client.latest(CAMERA_FRAME, **PLACE, view=3)
    until(lambda: service._sender._frames[3].matched)
    service.step()
    frame = until(frames.poll)
    view = decode_frame(frame.message, frame.payload)
    inner = pixels_in([ZONE], SIDE, SIDE)
    assert (view.depth_m[inner] == 0).all()
    assert (view.depth_m[~hidden] > 0).all()
    assert view.rgb[~hidden].std() > 30
    core = pixels_in([tuple((0.46 + 0.6 * (x - 0.46), 0.48 + 0.6 * (y - 0.48)) for x, y in ZONE)], SIDE, SIDE)
    assert view.rgb[core].max() <= 60  # black, but for what JPEG smears in from its rim
    truth = client.ask(TRUTH, source="camera-c1", view=3, parameters={"seq": "1"})
    thumbnail = client.ask(CAMERA_REQUEST, CameraRequest(stamp_ns=1, action="thumbnail", views=[3]), **PLACE).payload
    source = MaskedSource(pair([ZONE])[0], {3: [ZONE]})
    same = FrameEncoder(source, CameraSettings(jpeg_quality=camera_settings.jpeg_quality, disk_cache_mb=0))
    assert frame.payload == same.newest(3).payload
    assert thumbnail == same.thumbnail(3, camera_settings.thumbnail_width_px)
    assert bytes(truth.payload) == bytes(
        truth_to_wire(
            MaskedSource(pair([ZONE])[0], {3: [ZONE]}).latest(3).truth, source="camera/c1", view=3, seq=1, stamp_ns=1
        )[1]
    )


def test_its_own_eyes_see_nothing_of_the_zones(camera_node, make_node, camera_settings):
    client = patient(make_node("test", "t", alive=False))
    summaries = client.latest(CAMERA_SUMMARY, **PLACE)
    said = []
    for building in pair([ZONE]):
        perception = EdgePerception(camera_node, building, camera_settings, OwnPerception(building, Gossip))
        for view in range(12):
            perception._examined_s = -1e9
            perception._examine(view)
        perception._publish(1e9)
        said.append(until(summaries.poll).message.labels)
    assert said[0] == said[1]
    assert len(said[0]) == 4


def test_a_file_that_cant_be_believed_stops_the_camera(camera_node, make_camera, tmp_path):
    (tmp_path / "masks.yaml").write_text("c1: {0: [[[0, 0], [2, 2]]]}")
    bad = CameraSettings(masks=str(tmp_path / "masks.yaml"))
    with pytest.raises(ConfigError, match="expected 3 to"):
        CameraService(camera_node, make_camera(), bad)
    with pytest.raises(ConfigError, match="can't be read"):
        hide_mask_zones(make_camera(), CameraSettings(masks=str(tmp_path / "none.yaml")))


def test_without_zones_a_source_stays_itself(make_camera, camera_settings):
    camera = make_camera()
    assert hide_mask_zones(camera, CameraSettings()) is camera
    other = make_camera()
    other.place = other.place.__class__("c2", "0", (0, 0, 0), 1.8)
    assert hide_mask_zones(other, camera_settings) is other


def test_what_is_kept_of_a_view_is_that_of_its_zones():
    bare = Camera(scene="home")
    source, other = (MaskedSource(bare, {3: zones}) for zones in ([ZONE], [ZONE[::-1]]))
    assert len({bare.content(3), source.content(3), other.content(3)}) == 3
    assert source.content(4) == bare.content(4)
    assert MaskedSource(Camera(), {3: [ZONE]}).content(3) == ""
