"""JPEG over RTSP: what a reader gets is what was put in, and a reader that says nonsense harms nobody."""

from __future__ import annotations

import asyncio
import socket
import struct
import threading
from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from surveilnav.services.camera_node.sources.readers.reader import StreamError
from surveilnav.services.camera_node.sources.readers.rtsp import RtspReader
from surveilnav.simulator.hardware.rtsp import JpegScan, RtspServer, packets
from tests.streams import answers, free_port, room
from tests.waiting import until


def jpeg(width_px: int, height_px: int, *settings: int, seed: int = 0) -> bytes:
    bgr = cv2.cvtColor(room(seed, (width_px, height_px), noise=20.0), cv2.COLOR_RGB2BGR)
    return bytes(cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 85, *settings])[1])


def decoded(data: bytes) -> np.ndarray:
    return cv2.cvtColor(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB).astype(int)


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A server of two streams, one of which needs sequence numbers and offsets of more than 16 bits."""
    streams = {
        "lobby": [JpegScan.from_jpeg(jpeg(320, 240, seed=seed)) for seed in range(2)],
        "large": [JpegScan.from_jpeg(jpeg(1536, 1536))],
    }
    port, loop = free_port(), asyncio.new_event_loop()
    serving = loop.create_task(RtspServer(streams, fps=20.0).run("127.0.0.1", port))
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    until(lambda: answers(port))
    yield f"rtsp://127.0.0.1:{port}"
    loop.call_soon_threadsafe(serving.cancel)
    until(serving.done)
    loop.call_soon_threadsafe(loop.stop)
    thread.join(5.0)


def test_a_reader_gets_the_pictures_that_were_put_in(address: str) -> None:
    reader = RtspReader(f"{address}/lobby", period_s=0.0)
    reader.open()
    wanted = [decoded(jpeg(320, 240, seed=seed)) for seed in range(2)]
    came = [reader.read().rgb.astype(int) for _ in range(4)]
    reader.close()
    for rgb in came:  # two decoders differ in how they enlarge colour; the two pictures, by noise of 20
        assert min(np.abs(rgb - other).mean() for other in wanted) < 4.0
    assert np.abs(came[0] - came[1]).mean() > 5.0, "the pictures are shown in turn"


def test_a_large_picture_comes_whole(address: str) -> None:
    assert len(packets(JpegScan.from_jpeg(jpeg(1536, 1536)), 0, 0)) > 0xFFFF // 1400
    reader = RtspReader(f"{address}/large", period_s=0.0)
    reader.open()
    wanted = decoded(jpeg(1536, 1536))
    for _ in range(25):
        assert np.abs(reader.read().rgb.astype(int) - wanted).mean() < 4.0
    reader.close()


def test_a_stream_that_isnt_there_is_named(address: str) -> None:
    with pytest.raises(StreamError, match="no stream at the path /attic"):
        RtspReader(f"{address}/attic", period_s=0.0).open()


@pytest.mark.parametrize(
    "request_",
    [b"\r\n\r\n", b"GET / HTTP/1.0\r\n\r\n", b"$\x00\xff\xff", b"x" * 20_000, b"SETUP rtsp://h/lobby RTSP/1.0\r\n\r\n"],
)
def test_nonsense_ends_at_most_its_own_connection(address: str, request_: bytes) -> None:
    host, port = address.removeprefix("rtsp://").split(":")
    with socket.create_connection((host, int(port)), 2.0) as connection:
        connection.sendall(request_)
    test_a_stream_that_isnt_there_is_named(address)


def test_packets_are_as_the_rfc_has_them() -> None:
    scan = JpegScan.from_jpeg(jpeg(320, 240))
    made = packets(scan, 0xFFFE, 90_000)
    assert [struct.unpack(">H", p[2:4])[0] for p in made[:4]] == [0xFFFE, 0xFFFF, 0, 1]
    assert [p[1] & 0x80 for p in made] == [0] * (len(made) - 1) + [0x80], "the marker is on a picture's last packet"
    assert {p[1] & 0x7F for p in made} == {26}
    assert made[0][12:20] == bytes([0, 0, 0, 0, 1, 255, 40, 30])
    assert made[0][20:24] == bytes([0, 0, 0, 128]), "two tables of 8 bits"
    at = 0
    for number, packet in enumerate(made):
        assert int.from_bytes(packet[13:16], "big") == at
        at += len(packet) - (20 if number else 20 + 4 + 128)
    assert at == len(scan.data)


@pytest.mark.parametrize(
    "unfit",
    [
        b"",
        b"\xff\xd8\xff\xd9",
        jpeg(320, 240, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
        jpeg(320, 240, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444),
        jpeg(320, 240, cv2.IMWRITE_JPEG_OPTIMIZE, 1),
        jpeg(320, 240)[:200],
        jpeg(2048, 240),
        jpeg(324, 240),
    ],
)
def test_a_jpeg_that_cant_be_sent_is_refused(unfit: bytes) -> None:
    with pytest.raises(ValueError, match="baseline JPEG"):
        JpegScan.from_jpeg(unfit)
