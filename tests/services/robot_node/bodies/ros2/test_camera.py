"""Pictures as ROS drivers send them: encodings, padding, compression, wrong units, pairing by time."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest

from surveilnav.ros2 import types
from surveilnav.services.robot_node.bodies.ros2.camera import (
    PictureError,
    RobotCamera,
    decode_colour,
    decode_depth,
    lens_of,
)

RGB = np.random.default_rng(3).integers(0, 255, (6, 8, 3), dtype=np.uint8)
DEPTH_M = np.linspace(0.5, 4.0, 48, dtype=np.float32).reshape(6, 8)


def header(stamp_ns=0, frame="camera"):
    stamp = types.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return types.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)


def image(pixels, encoding, stamp_ns=0, padding=0, big=False):
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
    rows = np.pad(rows, ((0, 0), (0, padding)))
    return types.make(
        "sensor_msgs/msg/Image",
        header=header(stamp_ns),
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=int(big),
        step=rows.shape[1],
        data=rows.ravel(),
    )


def compressed(data, format, stamp_ns=0):
    return types.make(
        "sensor_msgs/msg/CompressedImage", header=header(stamp_ns), format=format, data=np.frombuffer(data, np.uint8)
    )


def camera_info(width=8, height=6, d=(), model="plumb_bob", f=7.0):
    roi = types.make("sensor_msgs/msg/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    k = np.array([f, 0, (width - 1) / 2, 0, f, (height - 1) / 2, 0, 0, 1], np.float64)
    return types.make(
        "sensor_msgs/msg/CameraInfo",
        header=header(),
        height=height,
        width=width,
        distortion_model=model,
        d=np.array(d, np.float64),
        k=k,
        r=np.eye(3).ravel(),
        p=np.zeros(12),
        binning_x=0,
        binning_y=0,
        roi=roi,
    )


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "pixels"),
    [
        ("rgb8", RGB),
        ("bgr8", RGB[..., ::-1]),
        ("rgba8", np.dstack([RGB, np.full((6, 8), 255, np.uint8)])),
        ("bgra8", np.dstack([RGB[..., ::-1], np.full((6, 8), 255, np.uint8)])),
    ],
)
def test_colour_comes_out_the_same_from_every_encoding(encoding, pixels, padding):
    np.testing.assert_array_equal(decode_colour(image(pixels, encoding, padding=padding)), RGB)


def test_grey_pictures_and_jpegs_are_colour_afterwards():
    grey = RGB[..., 0]
    np.testing.assert_array_equal(decode_colour(image(grey, "mono8")), np.repeat(grey[..., None], 3, axis=2))
    ok, data = cv2.imencode(".png", RGB[..., ::-1])
    assert ok
    np.testing.assert_array_equal(decode_colour(compressed(data.tobytes(), "rgb8; png compressed bgr8")), RGB)


@pytest.mark.parametrize("encoding", ["yuv422", "bayer_rggb8", ""])
def test_an_unknown_encoding_is_named(encoding):
    with pytest.raises(PictureError, match="got encoding"):
        decode_colour(image(RGB, encoding))


def test_fewer_bytes_than_the_header_says_are_named():
    message = image(RGB, "rgb8")
    message.data = message.data[:-1]
    with pytest.raises(PictureError, match="got 143 bytes"):
        decode_colour(message)


def test_depth_in_every_encoding():
    mm = np.round(DEPTH_M * 1000).astype(np.uint16)
    np.testing.assert_allclose(decode_depth(image(mm, "16UC1", padding=2)), mm / 1000, atol=1e-6)
    np.testing.assert_allclose(decode_depth(image(mm.astype(">u2"), "16UC1", big=True)), mm / 1000, atol=1e-6)
    np.testing.assert_allclose(decode_depth(image(DEPTH_M, "32FC1")), DEPTH_M, atol=1e-6)
    png = cv2.imencode(".png", mm)[1].tobytes()
    for_mm = compressed(struct.pack("<iff", 0, 0, 0) + png, "16UC1; compressedDepth")
    np.testing.assert_allclose(decode_depth(for_mm), mm / 1000, atol=1e-6)


def test_depth_of_floats_comes_back_from_its_inverse():
    """compressed_depth_image_transport: quantised inverse depth, raw = a / depth + b."""
    a, b = 100.0 * (100.0 + 1.0), 1.0 - (100.0 * 101.0) / 10.0
    raw = np.round(a / DEPTH_M + b).astype(np.uint16)
    png = cv2.imencode(".png", raw)[1].tobytes()
    message = compressed(struct.pack("<iff", 0, a, b) + png, "32FC1; compressedDepth")
    np.testing.assert_allclose(decode_depth(message), DEPTH_M, rtol=2e-3)


def test_what_has_no_depth_is_zero():
    depth = DEPTH_M.copy()
    depth[0, :3] = [np.nan, np.inf, -1.0]
    assert (decode_depth(image(depth, "32FC1"))[0, :3] == 0).all()


@pytest.mark.parametrize(
    ("message", "median"),
    [
        (image(DEPTH_M * 1000, "32FC1"), "2250 m"),
        (image(np.round(DEPTH_M).astype(np.uint16), "16UC1"), "0.002 m"),
    ],
)
def test_a_unit_that_is_not_the_encodings_is_named(message, median):
    with pytest.raises(PictureError, match=f"median of {median}: its driver mistakes metres and millimetres"):
        decode_depth(message)


def test_a_lens_and_its_faults():
    assert lens_of(camera_info()).pinhole.fx_px == 7.0
    assert len(lens_of(camera_info(d=(0.1, 0, 0, 0), model="equidistant")).distortion) == 4
    with pytest.raises(PictureError, match="unknown distortion model"):
        lens_of(camera_info(model="magic"))
    with pytest.raises(PictureError, match="can't be used"):
        lens_of(camera_info(f=0.0))


@pytest.fixture
def camera():
    camera = RobotCamera()
    camera.set_info(camera_info())
    return camera


def test_pictures_are_paired_by_their_stamps(camera):
    for k in range(4):
        camera.add_colour(image(RGB, "rgb8", k * 10**8))
        camera.add_depth(image(DEPTH_M + k, "32FC1", k * 10**8 + 3 * 10**7))
    assert camera.stamps() == [3 * 10**8, 2 * 10**8, 10**8, 0]
    pair = camera.pair(2 * 10**8)
    assert pair is not None
    np.testing.assert_allclose(pair.depth_m, DEPTH_M + 2)
    assert (pair.stamp_ns, pair.frame, pair.camera.width_px) == (2 * 10**8, "camera", 8)
    assert camera.missing() == ""


def test_it_says_what_is_missing(camera):
    assert camera.missing() == "no colour pictures and no depth pictures came yet"
    camera.add_colour(image(RGB, "rgb8", 0))
    assert camera.missing() == "no depth pictures came yet"
    camera.add_depth(image(DEPTH_M, "32FC1", 10**9))
    assert camera.missing() == "colour and depth are never nearer in time than 1.00 s"
    assert camera.stamps() == []


def test_a_picture_that_cannot_be_used_says_why_until_one_can(camera):
    camera.add_colour(image(RGB, "rgb8", 0))
    camera.add_depth(image(DEPTH_M * 1000, "32FC1", 0))
    assert camera.pair(0) is None
    assert "mistakes metres and millimetres" in camera.problem
    camera.add_colour(image(RGB, "rgb8", 10**8))
    camera.add_depth(image(DEPTH_M, "32FC1", 10**8))
    assert camera.pair(10**8) is not None
    assert camera.problem == ""


def test_depth_of_another_size_is_resized_if_it_has_the_same_shape(camera):
    camera.add_colour(image(RGB, "rgb8", 0))
    camera.add_depth(image(DEPTH_M[::2, ::2], "32FC1", 0))
    pair = camera.pair(0)
    assert pair is not None
    assert pair.depth_m.shape == (6, 8)
    camera.add_colour(image(RGB, "rgb8", 10**8))
    camera.add_depth(image(DEPTH_M[:, ::2], "32FC1", 10**8))
    assert camera.pair(10**8) is None
    assert "registered" in camera.problem


def test_a_distorted_picture_is_undistorted_with_its_depth():
    camera = RobotCamera()
    camera.set_info(camera_info(64, 48, d=(-0.3, 0.1, 0.0, 0.0, 0.0), f=40.0))
    rgb = np.zeros((48, 64, 3), np.uint8)
    depth = np.full((48, 64), 2.0, np.float32)
    camera.add_colour(image(rgb, "rgb8", 0))
    camera.add_depth(image(depth, "32FC1", 0))
    pair = camera.pair(0)
    assert pair is not None
    assert pair.depth_m[24, 32] == 2.0
    assert set(np.unique(pair.depth_m)) <= {np.float32(0.0), np.float32(2.0)}
