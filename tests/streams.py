"""Streams for tests: videos of a room with a sensor's noise, encoded to H.264, and servers that play them."""

from __future__ import annotations

import socket
import subprocess
import sys
import sysconfig
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import cv2
import numpy as np

from tests.waiting import until


def room(t: int = 0, size_px: tuple[int, int] = (320, 240), noise: float = 3.0) -> np.ndarray:
    """A picture (height, width, 3) of a still room: floor, wall, door and a lamp; ``t`` seeds the sensor's noise."""
    width, height = size_px
    picture = np.zeros((height, width, 3), np.float32)
    picture[: height // 2] = (190, 185, 170)
    picture[height // 2 :] = (120, 95, 70)
    picture += np.linspace(-25, 25, width, dtype=np.float32)[None, :, None]
    cv2.rectangle(picture, (width // 5, height // 4), (2 * width // 5, 3 * height // 4), (90, 60, 40), -1)
    cv2.circle(picture, (3 * width // 4, height // 5), height // 12, (250, 245, 200), -1)
    picture += np.random.default_rng(t).normal(0.0, noise, picture.shape)
    return np.clip(picture, 0, 255).astype(np.uint8)


def write_video(
    path: Path, frames: Iterator[np.ndarray], fps: int = 5, codec: str = "libx264", b_frames: int = 0
) -> Path:
    """An MP4 of pictures (height, width, 3) of one size. ``b_frames``: so many in a row refer to later ones."""
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=fps)
        stream.pix_fmt, stream.gop_size = "yuv420p", fps
        stream.codec_context.max_b_frames = b_frames
        for i, rgb in enumerate(frames):
            if i == 0:
                stream.width, stream.height = rgb.shape[1], rgb.shape[0]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24")))
        container.mux(stream.encode())
    return path


def write_looped_video(path: Path, frames: list[np.ndarray], seconds: float, fps: int = 5) -> Path:
    """An MP4 that shows these pictures again and again; they are encoded once, and their packets are repeated."""
    import av

    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=fps)
        stream.pix_fmt, stream.gop_size = "yuv420p", len(frames)
        stream.width, stream.height = frames[0].shape[1], frames[0].shape[0]
        stream.codec_context.max_b_frames = 0
        packets = [p for rgb in frames for p in stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24"))]
        packets += stream.encode()
        data = [(bytes(p), p.is_keyframe, p.time_base) for p in packets]
        for i in range(int(seconds * fps)):
            content, is_keyframe, time_base = data[i % len(data)]
            packet = av.Packet(content)
            packet.stream, packet.time_base, packet.is_keyframe = stream, time_base, is_keyframe
            packet.pts = packet.dts = round(i / fps / time_base)
            container.mux(packet)
    return path


def free_port() -> int:
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return int(s.getsockname()[1])


@contextmanager
def rtsp_server(folder: Path, host: str = "127.0.0.1") -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Serves each video of a folder as ``<address>/<name>.mp4`` at ``host``; yields the address and the server's process."""
    port, control = free_port(), free_port()
    script = Path(sysconfig.get_path("scripts")) / "rtsp-server"
    command = [sys.executable, "-c", f"import sys; sys.argv[0]={str(script)!r}; from server_demo import main; main()"]
    arguments = ["-d", str(folder), "-H", host, "-p", str(port), "-cp", str(control)]
    process = subprocess.Popen([*command, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder)
    try:
        until(lambda: answers(port, host), "the RTSP server never answered", 20.0)
        yield f"rtsp://{host}:{port}", process
    finally:
        process.kill()
        process.wait()


def answers(port: int, host: str = "127.0.0.1") -> bool:
    try:
        socket.create_connection((host, port), 0.5).close()
    except OSError:
        return False
    return True


@contextmanager
def http_server(answer: Callable[[BaseHTTPRequestHandler], None]) -> Iterator[str]:
    """An HTTP server whose GET requests ``answer`` answers; yields its address."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            try:
                answer(self)
            except (BrokenPipeError, ConnectionResetError):
                self.close_connection = True

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()


@contextmanager
def one_line_server(line: bytes) -> Iterator[int]:
    """A TCP server that answers whatever comes with one line; yields its port."""
    server = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        while True:
            try:
                connection, _ = server.accept()
            except OSError:
                return
            with connection:
                connection.recv(4096)
                connection.sendall(line)

    threading.Thread(target=serve, daemon=True).start()
    try:
        yield int(server.getsockname()[1])
    finally:
        server.close()


@contextmanager
def jittery(address: str, delay_s: float) -> Iterator[str]:
    """The same RTSP server behind a line that keeps what it sends for 0 to ``delay_s`` more, drawn anew for every packet."""
    host, port = address.removeprefix("rtsp://").split(":")
    listener = socket.create_server(("127.0.0.1", 0))
    rng = np.random.default_rng(1)

    def carry(source: socket.socket, sink: socket.socket, delayed: bool) -> None:
        try:
            while data := source.recv(8192):
                if delayed:
                    time.sleep(rng.uniform(0.0, delay_s))
                sink.sendall(data)
        except OSError:
            pass
        finally:
            sink.close()

    def accept() -> None:
        while True:
            try:
                near, _ = listener.accept()
            except OSError:
                return
            far = socket.create_connection((host, int(port)))
            threading.Thread(target=carry, args=(near, far, False), daemon=True).start()
            threading.Thread(target=carry, args=(far, near, True), daemon=True).start()

    threading.Thread(target=accept, daemon=True).start()
    try:
        yield f"rtsp://127.0.0.1:{listener.getsockname()[1]}"
    finally:
        listener.close()
