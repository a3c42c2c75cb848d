"""The codecs: exact where they promise it, within the stated error where not, and unmoved by hostile bytes."""

from __future__ import annotations

import math
import struct

import cv2
import msgspec
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from surveilnav.errors import WireError
from surveilnav.geometry import Pinhole, Pose, camera_pose
from surveilnav.messages import FrameHeader, PayloadPart
from surveilnav.sensing import depth_codec, packing

RANGE_M = (0.5, 5.0)
CAMERA = Pinhole.from_hfov(64, 48, math.radians(79))


def picture(seed: int = 0, width: int = 64, height: int = 48) -> np.ndarray:
    noise = np.random.default_rng(seed).integers(0, 255, (height // 8, width // 8, 3), dtype=np.uint8)
    return cv2.resize(noise, (width, height), interpolation=cv2.INTER_LINEAR)


def frame(**changes: object) -> tuple[FrameHeader, bytes]:
    depth = np.random.default_rng(1).uniform(0.6, 4.9, (48, 64)).astype(np.float32)
    payload, image, depth_part = packing.encode_rgbd(picture(), depth, depth_range_m=RANGE_M)
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
        image=image,
        depth=depth_part,
    )
    return msgspec.structs.replace(header, **changes), payload


@settings(max_examples=60, deadline=None)
@given(
    hnp.arrays(
        np.float32,
        hnp.array_shapes(min_dims=2, max_dims=2, max_side=24),
        elements=st.one_of(st.floats(-1, 12, width=32), st.just(math.nan), st.just(math.inf), st.just(0.0)),
    ),
    st.sampled_from([(0.5, 5.0), (0.1, 10.0), (0.3, 1000.0)]),
)
def test_depth_error_stays_within_half_a_quantum_of_inverse_depth(
    depth: np.ndarray, range_m: tuple[float, float]
) -> None:
    near, far = range_m
    back = depth_codec.decode_depth(depth_codec.encode_depth(depth, range_m), depth.shape[1], depth.shape[0], range_m)
    valid = (depth >= near) & (depth <= far)
    np.testing.assert_array_equal(back > 0, valid)
    inverse_error = np.abs(1 / back[valid].astype(np.float64) - 1 / depth[valid].astype(np.float64))
    assert np.all(inverse_error <= 0.501 * depth_codec.DEPTH_QUANTUM_PER_M)
    assert np.all((back[valid] >= np.float32(near)) & (back[valid] <= np.float32(far)))


def test_depth_format_matches_a_literal_reader() -> None:
    """The format as the module's docstring tells it, read pixel by pixel."""
    depth = np.random.default_rng(3).uniform(0.4, 6.0, (5, 7)).astype(np.float32)
    raw = zstandard.ZstdDecompressor().decompress(depth_codec.encode_depth(depth, RANGE_M))
    n = 35
    q = np.zeros((5, 7), dtype=int)
    for row in range(5):
        for col in range(7):
            i = row * 7 + col
            folded = raw[i] | raw[n + i] << 8
            delta = folded // 2 if folded % 2 == 0 else -(folded + 1) // 2
            before = q[row, col - 1] if col else (q[row - 1, 0] if row else 0)
            q[row, col] = (before + delta) % 65536
            expected = round(1000 / depth[row, col]) if 0.5 <= depth[row, col] <= 5.0 else 0
            assert abs(q[row, col] - expected) <= (expected > 0), "float32 may round a half the other way"


def test_frame_round_trip() -> None:
    header, payload = frame()
    view = packing.decode_frame(header, payload)
    assert (view.source, view.view, view.seq, view.stamp_ns, view.floor) == ("camera/c1", 3, 7, 1, "0")
    np.testing.assert_allclose(view.T_world_camera, camera_pose((1, 2, 1.8), 0.3, -0.5), atol=1e-9)
    assert view.rgb.shape == (48, 64, 3)
    assert np.abs(view.rgb.astype(int) - picture()).mean() < 4, "colours in their order, JPEG-close"
    assert view.depth_m.dtype == np.float32
    assert (view.depth_m > 0).all()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"source": "robot/../x"}, "source"),
        ({"source": "janitor"}, "source"),
        ({"seq": -1}, "seq"),
        ({"view": -1}, "view"),
        ({"mounting_offset_m": math.nan}, "mounting"),
        ({"depth_range_m": (5.0, 0.5)}, "range"),
        ({"depth_range_m": (math.nan, 5.0)}, "range"),
        ({"depth_range_m": (0.5, math.inf)}, "range"),
        ({"camera": Pinhole.from_hfov(48, 64, 1.0)}, "JPEG"),
        ({"camera": Pinhole.from_hfov(16384, 16384, 1.0)}, "pixels"),
        ({"image": PayloadPart("jpeg", 10)}, "payload"),
        ({"image": PayloadPart("jpeg", -5)}, "payload"),
        ({"image": PayloadPart("depth-invq-zstd", 1)}, "parts"),
        ({"T_world_camera": Pose((1e9, 0, 0), (0, 0, 0, 1))}, "position"),
    ],
)
def test_headers_that_make_no_sense(changes: dict[str, object], word: str) -> None:
    with pytest.raises(WireError, match=word):
        packing.decode_frame(*frame(**changes))


def test_a_pose_with_nan_never_leaves_the_decoder() -> None:
    header, _ = frame()
    wire = msgspec.to_builtins(header)
    wire["T_world_camera"]["translation_m"] = [math.nan, 0.0, 0.0]
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(wire, FrameHeader)


@pytest.mark.parametrize("cut", [0, 1, 2, 20, 200, -1])
def test_cut_jpeg(cut: int) -> None:
    with pytest.raises(WireError):
        packing.decode_jpeg(packing.encode_jpeg(picture())[:cut], 64, 48)


def test_a_jpeg_without_its_end_is_called_cut_off() -> None:
    with pytest.raises(WireError, match="cut off"):
        packing.decode_jpeg(packing.encode_jpeg(picture())[:-1], 64, 48)


def test_jpeg_bomb_is_refused_before_decoding(monkeypatch: pytest.MonkeyPatch) -> None:
    data = bytearray(packing.encode_jpeg(picture()))
    at = data.index(b"\xff\xc0")
    data[at + 5 : at + 9] = struct.pack(">HH", 65000, 65000)
    monkeypatch.setattr(packing.cv2, "imdecode", lambda *_: pytest.fail("decoded"))
    with pytest.raises(WireError, match="65000"):
        packing.decode_jpeg(bytes(data), 64, 48)
    with pytest.raises(WireError, match="pixels"):
        packing.decode_jpeg(bytes(data), 65000, 65000)


def test_other_pictures_are_refused() -> None:
    grey = cv2.imencode(".jpg", picture()[..., 0])[1].tobytes()
    progressive = cv2.imencode(".jpg", picture(), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    png = cv2.imencode(".png", picture())[1].tobytes()
    for data, word in ((grey, "components"), (progressive, "progressive"), (png, "FF D8")):
        with pytest.raises(WireError, match=word):
            packing.decode_jpeg(data, 64, 48)


def test_zstd_bombs_are_refused_before_decompressing(monkeypatch: pytest.MonkeyPatch) -> None:
    bomb = zstandard.compress(bytes(100_000_000))
    monkeypatch.setattr(zstandard, "ZstdDecompressor", lambda: pytest.fail("decompressed"))
    with pytest.raises(WireError, match="100000000"):
        depth_codec.decode_depth(bomb, 64, 48, RANGE_M)


def test_zstd_bombs_and_other_bytes_are_refused() -> None:
    bomb = zstandard.compress(bytes(100_000_000))
    unsized = zstandard.ZstdCompressor(write_content_size=False).compress(bytes(2 * 64 * 48))
    twice = zstandard.compress(bytes(2 * 64 * 48)) * 2
    for data in (bomb, unsized, twice, b"", b"\x28\xb5\x2f\xfd"):
        with pytest.raises(WireError):
            depth_codec.decode_depth(data, 64, 48, RANGE_M)


@settings(max_examples=150, deadline=None)
@given(st.data())
def test_flipped_bytes_give_a_view_or_a_wire_error(data: st.DataObject) -> None:
    header, payload = frame()
    broken = bytearray(payload)
    for _ in range(data.draw(st.integers(1, 5))):
        broken[data.draw(st.integers(0, len(broken) - 1))] = data.draw(st.integers(0, 255))
    try:
        view = packing.decode_frame(header, bytes(broken))
    except WireError:
        return
    assert view.rgb.shape == (48, 64, 3)
    assert np.isfinite(view.depth_m).all()
    assert ((view.depth_m == 0) | ((view.depth_m >= 0.5) & (view.depth_m <= 5.0))).all()


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 1024))
def test_embedding_round_trip(seed: int, dim: int) -> None:
    vector = np.random.default_rng(seed).normal(size=dim).astype(np.float32)
    vector /= np.linalg.norm(vector)
    back = packing.unpack_embedding(packing.pack_embedding(vector), dim)
    assert abs(np.linalg.norm(back) - 1) < 1e-6
    np.testing.assert_allclose(back, vector, atol=1e-3)


def test_embeddings_that_lie() -> None:
    unit = np.full(4, 0.5, dtype=np.float32)
    for bad in (
        b"",
        b"\0",
        np.zeros(4, "<f2").tobytes(),
        np.full(4, np.nan, "<f2").tobytes(),
        (unit * 9).astype("<f2").tobytes(),
    ):
        with pytest.raises(WireError, match="embedding"):
            packing.unpack_embedding(bad)
    with pytest.raises(WireError, match="80"):
        packing.unpack_embedding(packing.pack_embedding(unit), 80)
    with pytest.raises(WireError, match="embedding"):
        packing.unpack_embedding(bytes(2 * (packing.MAX_EMBEDDING_DIM + 1)))


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("shape", [(0, 6), (3, 5), (2, 3, 4)])
def test_array_round_trip(dtype: type, shape: tuple[int, ...]) -> None:
    array = (np.random.default_rng(0).random(shape) * 200).astype(dtype)
    np.testing.assert_array_equal(packing.unpack_array(packing.pack_array(array), dtype, shape), array)


def test_arrays_that_lie() -> None:
    data = packing.pack_array(np.zeros((1000, 1000), np.float32))
    for shape in ((10, 10), (1000, 1001), (-1, -1), (10**6, 10**6), (1,) * 9):
        with pytest.raises(WireError):
            packing.unpack_array(data, np.float32, shape)
    with pytest.raises(WireError, match="up to"):
        packing.unpack_array(data, np.float32, (1000, 1000), max_bytes=1000)
