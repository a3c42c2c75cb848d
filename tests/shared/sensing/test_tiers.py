"""Each tier, there and back: what it keeps, what it leaves out, and what happens to payloads that were tampered with."""

from __future__ import annotations

import math
from typing import get_args

import msgspec
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.errors import WireError
from surveilnav.geometry import Pinhole, Pose, camera_pose
from surveilnav.messages import PERCEIVED_TIERS, FrameHeader, ModelIds, PayloadPart, Tier
from surveilnav.sensing.packing import decode_frame, decode_jpeg, picture_jpeg
from surveilnav.sensing.perceived import perceived_reply
from surveilnav.sensing.replies import perception_from_wire
from surveilnav.sensing.tiers import EncodedView, Seen, encode_view
from surveilnav.sensing.views import DetectedObject, ViewPerception

RANGE_M = (0.3, 10.0)
CAMERA = Pinhole.from_hfov(200, 160, math.radians(90))
MODELS = ModelIds("a detector", "a segmenter", "a space")
TIERS: tuple[Tier, ...] = get_args(Tier)


def unit(seed: int) -> np.ndarray:
    vector = np.abs(np.random.default_rng(seed).normal(size=128))
    return (vector / np.linalg.norm(vector)).astype(np.float32)


def ellipse(rows: int, cols: int) -> np.ndarray:
    y, x = np.mgrid[:rows, :cols]
    return ((2 * y + 1 - rows) / rows) ** 2 + ((2 * x + 1 - cols) / cols) ** 2 <= 1.0


PERCEPTION = ViewPerception(
    "a backend",
    (
        DetectedObject("tv", 0.91, (20.0, 30.0, 100.0, 90.0), ellipse(60, 80), unit(1), 0.83),
        DetectedObject("couch", 0.4, (110.3, 100.2, 180.9, 159.5), None, unit(2), 0.15),
        DetectedObject("not a word", 0.7, (0.0, 0.0, 200.0, 160.0), None, unit(3), None),
    ),
    unit(4),
    "a space",
    ("bed", "couch", "tv"),
)
SEEN = Seen(PERCEPTION, MODELS)
RGB = np.random.default_rng(5).integers(0, 255, (160, 200, 3), dtype=np.uint8)
DEPTH_M = np.tile(np.linspace(1.0, 4.0, 200, dtype=np.float32), (160, 1))


def header_of(view: EncodedView, tier: Tier, **changes: object) -> FrameHeader:
    header = FrameHeader(
        stamp_ns=1,
        source="camera/c1",
        view=3,
        seq=7,
        floor="0",
        T_world_camera=Pose.from_matrix(camera_pose((1, 2, 1.8), 0.3, -0.5)),
        camera=CAMERA,
        mounting_offset_m=1.8,
        depth_range_m=RANGE_M,
        image=view.image,
        depth=view.depth,
        tier=tier,
        perceived=view.perceived,
    )
    return msgspec.structs.replace(header, **changes)


def encoded(tier: Tier, seen: Seen | None = SEEN) -> tuple[FrameHeader, bytes]:
    view = encode_view(tier, RGB, DEPTH_M, CAMERA, depth_range_m=RANGE_M, seen=seen)
    return header_of(view, tier), view.payload


@pytest.mark.parametrize("tier", TIERS)
def test_every_tier_comes_back_as_a_view_of_the_same_size(tier):
    view = decode_frame(*encoded(tier))
    assert (view.rgb.shape, view.depth_m.shape) == (RGB.shape, DEPTH_M.shape)


def test_raw_loses_nothing_but_a_tenth_of_a_millimetre():
    view = decode_frame(*encoded("raw"))
    np.testing.assert_array_equal(view.rgb, RGB)
    assert np.abs(view.depth_m - DEPTH_M).max() <= 0.5 * 0.0001 * DEPTH_M.max() ** 2 + 1e-5


def test_tiers_are_smaller_from_one_to_the_next():
    sizes = [len(encoded(tier)[1]) for tier in ("raw", "jpeg+depth", "features", "objects")]
    assert sizes == sorted(sizes, reverse=True)


def test_a_jpeg_alone_has_no_depth():
    assert not decode_frame(*encoded("jpeg")).depth_m.any()


def test_features_keep_what_the_camera_saw():
    reply = perceived_reply(*encoded("features"))
    assert (reply.source, reply.view, reply.seq, reply.models) == ("camera/c1", 3, 7, MODELS)
    seen = perception_from_wire(reply, CAMERA)
    assert (seen.words, seen.embedding_model) == (PERCEPTION.words, "a space")
    assert [d.label for d in seen.detections] == ["tv", "couch", "not a word"]
    for found, true in zip(seen.detections, PERCEPTION.detections, strict=True):
        assert found.score == pytest.approx(true.score, abs=0.5 / 254)
        assert (found.chance is None) == (true.chance is None)
        assert found.confidence == pytest.approx(true.confidence, abs=0.5 / 254)
        assert found.embedding @ true.embedding > 0.998
        assert all(abs(a - b) < 1.0 for a, b in zip(found.box_px, true.box_px, strict=True))
    assert seen.image_embedding @ PERCEPTION.image_embedding > 0.998
    mask, true_mask = seen.detections[0].mask, PERCEPTION.detections[0].mask
    assert mask.shape == true_mask.shape
    assert (mask & true_mask).sum() / (mask | true_mask).sum() > 0.8
    assert seen.detections[1].mask is None


def test_objects_have_depth_where_likely_objects_are_and_nowhere_else():
    only_tv = Seen(with_detections(PERCEPTION, PERCEPTION.detections[:2]), MODELS)
    view = decode_frame(*encoded("objects", only_tv))
    known = view.depth_m > 0
    assert known[45:75, 40:80].all()  # the tv, of which the mask is an ellipse
    assert not known[104:].any()
    assert not known[:, 116:].any()
    seen = perception_from_wire(perceived_reply(*encoded("objects", only_tv)), CAMERA)
    assert [(d.label, d.mask) for d in seen.detections] == [("tv", None)]


def with_detections(perception: ViewPerception, detections: tuple[DetectedObject, ...]) -> ViewPerception:
    return ViewPerception(
        perception.backend, detections, perception.image_embedding, perception.embedding_model, perception.words
    )


@pytest.mark.parametrize("tier", PERCEIVED_TIERS)
def test_a_view_that_the_camera_cant_read_has_no_perception(tier):
    header, payload = encoded(tier, None)
    assert perceived_reply(header, payload) is None
    assert (decode_frame(header, payload).depth_m > 0).any() == (tier == "features")


def test_objects_without_objects_say_that_they_have_no_depth():
    view = encode_view("objects", RGB, DEPTH_M, CAMERA, depth_range_m=RANGE_M, seen=None)
    assert not view.has_depth
    assert encode_view("features", RGB, DEPTH_M, CAMERA, depth_range_m=RANGE_M, seen=None).has_depth


def test_a_small_picture_is_refused_in_a_tier_that_sends_the_whole():
    header, payload = encoded("features")
    whole = msgspec.structs.replace(header, tier="jpeg+depth")
    with pytest.raises(WireError, match="JPEG"):
        decode_frame(whole, payload)


@pytest.mark.parametrize(
    "part",
    [
        PayloadPart("perceived-zstd", -1),
        PayloadPart("perceived-zstd", 10),
        PayloadPart("perceived-zstd", 1 << 40),
        PayloadPart("jpeg", 100),
        PayloadPart("perceived-zstd", 0),
    ],
)
def test_parts_that_dont_add_up_are_refused(part):
    header, payload = encoded("features")
    wrong = msgspec.structs.replace(header, perceived=part)
    with pytest.raises(WireError):
        perceived_reply(wrong, payload)


@pytest.mark.parametrize("divisor", [0, -8, 65, 1 << 40])
def test_cells_of_no_size_are_refused(divisor):
    header, payload = encoded("features")
    part = msgspec.structs.replace(header.perceived, divisor=divisor)
    with pytest.raises(WireError):
        perceived_reply(msgspec.structs.replace(header, perceived=part), payload)


def test_bombs_are_refused_before_they_are_unpacked(monkeypatch):
    header, payload = encoded("features")
    bomb = zstandard.compress(bytes(100_000_000))
    begin = len(payload) - header.perceived.n_bytes
    part = msgspec.structs.replace(header.perceived, n_bytes=len(bomb))
    monkeypatch.setattr(zstandard, "ZstdDecompressor", lambda: pytest.fail("decompressed"))
    with pytest.raises(WireError, match="4194304"):
        perceived_reply(msgspec.structs.replace(header, perceived=part), payload[:begin] + bomb)


def repacked(change) -> tuple[FrameHeader, bytes]:
    """A frame whose perceived part says something else: ``change`` is given its fields, and changes them."""
    header, payload = encoded("features")
    begin = len(payload) - header.perceived.n_bytes
    fields = msgspec.msgpack.decode(zstandard.decompress(payload[begin:]))
    change(fields)
    data = zstandard.compress(msgspec.msgpack.encode(fields))
    part = msgspec.structs.replace(header.perceived, n_bytes=len(data))
    return msgspec.structs.replace(header, perceived=part), payload[:begin] + data


LABELS, SCORES, BOXES, EMBEDDINGS, MASKS = 3, 4, 6, 7, 8
LIES = {
    "a number of no word": lambda f: f[LABELS].__setitem__(0, 99),
    "a negative number": lambda f: f[LABELS].__setitem__(0, -1),
    "an empty word": lambda f: f[LABELS].__setitem__(0, ""),
    "a score too few": lambda f: f.__setitem__(SCORES, f[SCORES][:-1]),
    "half a box": lambda f: f.__setitem__(BOXES, f[BOXES][:-3]),
    "a box outside": lambda f: f.__setitem__(BOXES, np.array([300, 300, 400, 400] * 3, "<u2").tobytes()),
    "a box inside out": lambda f: f.__setitem__(BOXES, np.array([90, 90, 10, 10] * 3, "<u2").tobytes()),
    "embeddings of different lengths": lambda f: f.__setitem__(EMBEDDINGS, f[EMBEDDINGS][:-1]),
    "no embeddings": lambda f: f.__setitem__(EMBEDDINGS, b""),
    "an embedding of zeros": lambda f: f.__setitem__(EMBEDDINGS, bytes(len(f[EMBEDDINGS]))),
    "a mask too small": lambda f: f[MASKS].__setitem__(0, [1, 2]),
    "a mask of negative runs": lambda f: f[MASKS].__setitem__(0, [-5, 85]),
    "a mask too few": lambda f: f.__setitem__(MASKS, f[MASKS][:-1]),
    "fields of another kind": lambda f: f.__setitem__(LABELS, 5),
    "words too long": lambda f: f.__setitem__(2, ["x" * 1000] * 3),
}


@pytest.mark.parametrize("lie", LIES)
def test_lies_about_what_was_seen_are_refused(lie):
    header, payload = repacked(LIES[lie])
    with pytest.raises(WireError):
        perception_from_wire(perceived_reply(header, payload), CAMERA)


def test_masks_that_cover_the_picture_too_often_are_refused_before_they_are_made(monkeypatch):
    """A few hundred bytes would else take gigabytes."""

    def many(fields):
        fields[LABELS], n = [2] * 40, 40
        fields[SCORES], fields[5] = bytes(n), bytes(n)
        fields[BOXES] = np.array([0, 0, 200, 160] * n, "<u2").tobytes()
        fields[EMBEDDINGS] = bytes([1] * 128 * (n + 1))
        fields[MASKS] = [[0, 500]] * n

    header, payload = repacked(many)
    monkeypatch.setattr("surveilnav.sensing.perceived.rle.decode", lambda *a: pytest.fail("a mask was made"))
    with pytest.raises(WireError, match="32 times"):
        perceived_reply(header, payload)


@pytest.mark.parametrize("tier", TIERS)
def test_people_are_shown_a_jpeg_of_the_views_size(tier):
    header, payload = encoded(tier)
    jpeg = picture_jpeg(header, payload)
    assert decode_jpeg(jpeg, 200, 160).shape == RGB.shape
    if tier in ("jpeg", "jpeg+depth"):
        assert jpeg == payload[: header.image.n_bytes]
    with pytest.raises(WireError):
        picture_jpeg(msgspec.structs.replace(header, tier="raw", image=PayloadPart("png", 20)), payload)


def test_the_lies_are_what_is_refused():
    header, payload = repacked(lambda f: None)
    assert len(perception_from_wire(perceived_reply(header, payload), CAMERA).detections) == 3


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(TIERS), st.data())
def test_mutated_payloads_give_a_view_or_a_wire_error(tier, data):
    """What is accepted is a view of sane numbers."""
    header, payload = encoded(tier)
    mutated = bytearray(payload)
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(mutated) - 1))
        mutated[at] = data.draw(st.integers(0, 255))
    cut = data.draw(st.sampled_from([0, 0, 0, 1, len(mutated) // 2]))
    bad = bytes(mutated[: len(mutated) - cut])
    try:
        view = decode_frame(header, bad)
        assert view.rgb.shape == RGB.shape
        assert view.depth_m.shape == DEPTH_M.shape
        known = view.depth_m[view.depth_m != 0]
        assert ((known >= RANGE_M[0] * 0.999) & (known <= RANGE_M[1] * 1.001)).all()
        reply = perceived_reply(header, bad)
        if reply is not None:
            perception_from_wire(reply, CAMERA)
    except WireError:
        pass


@settings(max_examples=200, deadline=None)
@given(st.sampled_from(TIERS), st.data())
def test_damaged_depth_and_perception_are_never_taken(tier, data):
    """Colours may come through a damaged picture; geometry and objects never: a damaged part is refused, or means the same."""
    header, payload = encoded(tier)
    true = decode_frame(header, payload)
    damaged = bytearray(payload)
    at = data.draw(st.integers(header.image.n_bytes, len(damaged) - 1))
    damaged[at] ^= data.draw(st.integers(1, 255))
    try:
        view = decode_frame(header, bytes(damaged))
        reply = perceived_reply(header, bytes(damaged))
    except WireError:
        return
    np.testing.assert_array_equal(view.depth_m, true.depth_m)
    assert reply == perceived_reply(header, payload)
