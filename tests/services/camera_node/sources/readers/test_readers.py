from __future__ import annotations

import os
import signal
import threading
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from surveilnav.errors import ConfigError
from surveilnav.services.camera_node.sources.readers.choose import choose_reader
from surveilnav.services.camera_node.sources.readers.folder import FolderReader
from surveilnav.services.camera_node.sources.readers.http import HttpReader
from surveilnav.services.camera_node.sources.readers.reader import StreamError
from surveilnav.services.camera_node.sources.readers.rtsp import RtspReader, diagnose
from surveilnav.services.camera_node.sources.readers.usb import UsbReader
from surveilnav.services.camera_node.sources.readers.video_file import VideoFileReader
from tests import streams

SIZE = (320, 240)


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("videos")
    for name, codec in (("h264", "libx264"), ("h265", "libx265")):
        streams.write_video(folder / f"{name}.mp4", (streams.room(t) for t in range(100)), codec=codec)
    return folder


def jpeg(t: int) -> bytes:
    return cv2.imencode(".jpg", streams.room(t)[..., ::-1])[1].tobytes()


def same_room(rgb: np.ndarray) -> bool:
    return rgb.shape == (240, 320, 3) and float(np.abs(rgb.astype(float) - streams.room(noise=0.0)).mean()) < 6.0


@pytest.mark.parametrize("codec", ["h264", "h265"])
def test_rtsp(videos: Path, codec: str) -> None:
    with streams.rtsp_server(videos) as (address, _):
        reader = RtspReader(f"{address}/{codec}.mp4", period_s=0.0)
        reader.open()
        try:
            frames = [reader.read() for _ in range(3)]
            first_bytes = reader.bytes_read
            for _ in range(3):
                reader.read()
        finally:
            reader.close()
    assert all(frame is not None and same_room(frame.rgb) for frame in frames)
    assert 0 < first_bytes <= reader.bytes_read, "the bytes of its connection aren't counted"
    assert [f.clock for f in frames if f] == ["arrival"] * 3
    assert abs(frames[-1].captured_ns - time.time_ns()) < 10e9


def numbered(t: int) -> np.ndarray:
    """A room whose lower edge is brighter by 2 in each picture, so that their order can be seen."""
    picture = streams.room(t)
    picture[200:] = 40 + 2 * t
    return picture


def test_pictures_that_refer_to_later_ones_come_in_their_order(tmp_path: Path) -> None:
    streams.write_video(tmp_path / "b.mp4", (numbered(t) for t in range(60)), b_frames=3)
    with streams.rtsp_server(tmp_path) as (address, _):
        reader = RtspReader(f"{address}/b.mp4", period_s=0.0)
        reader.open()
        try:
            shown = [(reader.read().rgb[210:].mean() - 40) / 2 for _ in range(12)]
        finally:
            reader.close()
    assert np.diff(shown) == pytest.approx(1.0, abs=0.7)


def test_a_line_with_jitter_loses_nothing(videos: Path) -> None:
    with streams.rtsp_server(videos) as (server, _), streams.jittery(server, 0.2) as address:
        reader = RtspReader(f"{address}/h264.mp4", period_s=0.0)
        reader.open()
        try:
            assert all(same_room(reader.read().rgb) for _ in range(10))
        finally:
            reader.close()


def test_a_killed_rtsp_server_ends_the_stream(videos: Path) -> None:
    with streams.rtsp_server(videos) as (address, process):
        reader = RtspReader(f"{address}/h264.mp4", period_s=0.0)
        reader.open()
        reader.read()
        os.kill(process.pid, signal.SIGKILL)
        with pytest.raises(StreamError, match="ended or stalled"):
            _read_to_the_end(reader)
        reader.close()


def test_rtsp_of_a_wrong_path_says_so(videos: Path) -> None:
    with streams.rtsp_server(videos) as (address, _):
        reader = RtspReader(f"{address}/nothing.mp4", period_s=0.0)
        with pytest.raises(StreamError, match=r"no stream at the path /nothing\.mp4"):
            reader.open()


@pytest.mark.parametrize(
    ("line", "address", "reason"),
    [
        (b"RTSP/1.0 401 Unauthorized\r\n\r\n", "rtsp://u:hunter2@127.0.0.1:{}/a", "refuses this user and password"),
        (b"RTSP/1.0 401 Unauthorized\r\n\r\n", "rtsp://127.0.0.1:{}/a", "wants a user and a password"),
        (b"HTTP/1.1 400 Bad Request\r\n\r\n", "rtsp://127.0.0.1:{}/a", "doesn't speak RTSP; a web page"),
        (b"RTSP/1.0 200 OK\r\n\r\n", "rtsp://127.0.0.1:{}/a", "can't be decoded; expected H.264"),
        (b"RTSP/1.0 503 Busy\r\n\r\n", "rtsp://127.0.0.1:{}/a", "RTSP status 503"),
    ],
)
def test_why_an_rtsp_stream_cannot_be_opened(line: bytes, address: str, reason: str) -> None:
    with streams.one_line_server(line) as port:
        found = diagnose(address.format(port))
    assert reason in found
    assert "hunter2" not in found


def test_rtsp_where_nobody_listens() -> None:
    assert "refuses connections" in diagnose(f"rtsp://127.0.0.1:{streams.free_port()}/a")


def test_a_video_file_plays_at_its_own_pace_and_over_and_over(videos: Path, tmp_path: Path) -> None:
    short = streams.write_video(tmp_path / "short.mp4", (streams.room(t) for t in range(5)), fps=10)
    reader = VideoFileReader(short, period_s=0.0)
    reader.open()
    begun_s = time.monotonic()
    frames = [reader.read() for _ in range(12)]
    reader.close()
    assert all(frame is not None and same_room(frame.rgb) for frame in frames)
    assert time.monotonic() - begun_s > 0.8  # twelve pictures at ten a second, in three rounds


def test_a_folder_gives_each_new_picture_once(tmp_path: Path) -> None:
    reader = FolderReader(tmp_path, period_s=0.05)
    reader.open()
    assert reader.read() is None
    (tmp_path / "a.jpg").write_bytes(jpeg(1))
    first = reader.read()
    assert first is not None
    assert same_room(first.rgb)
    assert first.captured_ns == (tmp_path / "a.jpg").stat().st_mtime_ns
    assert reader.read() is None
    threading.Timer(0.3, lambda: (tmp_path / "b.png").write_bytes(cv2.imencode(".png", streams.room(2))[1])).start()
    assert reader.read() is not None


def test_a_half_written_picture_is_waited_for(tmp_path: Path) -> None:
    reader = FolderReader(tmp_path, period_s=0.05)
    whole = jpeg(1)
    (tmp_path / "a.jpg").write_bytes(whole[:10])
    threading.Timer(0.3, lambda: (tmp_path / "a.jpg").write_bytes(whole)).start()
    assert reader.read() is not None


def test_a_folder_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(StreamError, match="isn't a folder"):
        FolderReader(tmp_path / "x", 0.1).open()


def with_thumbnail(data: bytes) -> bytes:
    """A JPEG with another one embedded in its header, as some cameras make them."""
    thumbnail = b"Exif\0\0" + cv2.imencode(".jpg", streams.room(0)[::8, ::8, ::-1])[1].tobytes()
    return data[:2] + b"\xff\xe1" + (len(thumbnail) + 2).to_bytes(2, "big") + thumbnail + data[2:]


def test_mjpeg_with_lengths_may_have_thumbnails_in_its_pictures() -> None:
    def stream(request) -> None:  # type: ignore[no-untyped-def]
        request.send_response(200)
        request.send_header("Content-Type", "multipart/x-mixed-replace; boundary=b")
        request.end_headers()
        for t in range(3):
            data = with_thumbnail(jpeg(t))
            head = f"--b\r\nContent-Type: image/jpeg\r\ncontent-length: {len(data)}\r\n\r\n"
            request.wfile.write(head.encode() + data + b"\r\n")

    with streams.http_server(stream) as address:
        reader = HttpReader(f"{address}/video", 0.0)
        reader.open()
        frames = [reader.read() for _ in range(3)]
        reader.close()
    assert all(frame is not None and same_room(frame.rgb) for frame in frames)


def test_mjpeg() -> None:
    def stream(request) -> None:  # type: ignore[no-untyped-def]
        request.send_response(200)
        request.send_header("Content-Type", "multipart/x-mixed-replace; boundary=b")
        request.end_headers()
        for t in range(20):
            data = jpeg(t)
            request.wfile.write(b"--b\r\nContent-Type: image/jpeg\r\n\r\n" + data + b"\r\n")

    with streams.http_server(stream) as address:
        reader = HttpReader(f"{address}/video", 0.0)
        reader.open()
        frames = [reader.read() for _ in range(20)]
        assert all(frame is not None and same_room(frame.rgb) for frame in frames)
        assert reader.bytes_read == sum(len(jpeg(t)) for t in range(20))
        with pytest.raises(StreamError, match="has ended"):
            reader.read()
        reader.close()


def test_single_pictures_with_a_password() -> None:
    asked: list[str] = []

    def picture(request) -> None:  # type: ignore[no-untyped-def]
        given = request.headers.get("Authorization", "")
        asked.append(given.split(" ")[0])
        if given != "Basic dTpwQHM=":  # u:p@s
            request.send_response(401)
            request.send_header("WWW-Authenticate", 'Basic realm="camera"')
            request.end_headers()
            return
        request.send_response(200)
        request.send_header("Content-Type", "image/jpeg")
        request.end_headers()
        request.wfile.write(jpeg(1))

    with streams.http_server(picture) as address:
        host = address.removeprefix("http://")
        reader = HttpReader(f"http://u:p%40s@{host}/snap.jpg", 0.01)
        reader.open()
        frames = [reader.read() for _ in range(3)]
        reader.close()
        assert all(frame is not None and same_room(frame.rgb) for frame in frames)
        for wrong, reason in (("u:x@", "refuses this user"), ("", "wants a user and a password")):
            with pytest.raises(StreamError, match=reason):
                HttpReader(f"http://{wrong}{host}/snap.jpg", 0.01).open()


def test_a_web_page_is_no_camera() -> None:
    def page(request) -> None:  # type: ignore[no-untyped-def]
        request.send_response(200)
        request.send_header("Content-Type", "text/html; charset=utf-8")
        request.end_headers()
        request.wfile.write(b"<html>")

    with streams.http_server(page) as address, pytest.raises(StreamError, match=r"text/html \(a web page\)"):
        HttpReader(address, 0.1).open()


def test_a_usb_camera_that_is_missing() -> None:
    with pytest.raises(StreamError, match="there is no /dev/video77"):
        UsbReader("usb:77", SIZE, 0.1).open()


@pytest.mark.parametrize(
    ("stream", "kind"),
    [
        ("rtsp://a/b", RtspReader),
        ("http://a/b", HttpReader),
        ("usb:1", UsbReader),
        ("/dev/video2", UsbReader),
        ("pictures", FolderReader),
        ("walk.mp4", VideoFileReader),
    ],
)
def test_the_address_chooses_the_reader(tmp_path: Path, stream: str, kind: type) -> None:
    (tmp_path / "pictures").mkdir()
    assert isinstance(choose_reader(stream, tmp_path, {}, SIZE, 1.0), kind)


def test_an_address_that_nothing_reads(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="ftp:// can't be read"):
        choose_reader("ftp://a/b", tmp_path, {}, SIZE, 1.0)
    with pytest.raises(ConfigError, match="PASSWORD isn't set"):
        choose_reader("rtsp://u:${PASSWORD}@a/b", tmp_path, {}, SIZE, 1.0)


def _read_to_the_end(reader: RtspReader) -> None:
    for _ in range(200):
        reader.read()
