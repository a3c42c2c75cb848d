"""Pictures from an RTSP stream (H.264, H.265, MJPEG), over TCP."""

from __future__ import annotations

import os
import socket
import ssl
from urllib.parse import urlsplit

import cv2

from surveilnav.bus.traffic import WireCounter
from surveilnav.services.camera_node.sources.readers.opencv import OPEN_TIMEOUT_MS, READ_TIMEOUT_MS, OpenCVReader
from surveilnav.services.camera_node.sources.readers.reader import CapturedFrame

_PORTS = {"rtsp": 554, "rtsps": 322}
_PROBE_S = 3.0
#: TCP: UDP loses packets on busy networks, and firewalls seldom let it through. The rest has FFmpeg look at the stream for one
#: second before it hands out pictures, instead of five.
_OPTIONS = "rtsp_transport;tcp|analyzeduration;1000000|probesize;1000000"


class RtspReader(OpenCVReader):
    """Reads an RTSP stream. It always takes all pictures from the stream: else the decoder's queue grows and they get old."""

    def __init__(self, address: str, period_s: float) -> None:
        os.environ.setdefault("OPENCV_FFMPEG_CAPTURE_OPTIONS", _OPTIONS)
        limits = [cv2.CAP_PROP_OPEN_TIMEOUT_MSEC, OPEN_TIMEOUT_MS, cv2.CAP_PROP_READ_TIMEOUT_MSEC, READ_TIMEOUT_MS]
        super().__init__(address, cv2.CAP_FFMPEG, [*limits, cv2.CAP_PROP_N_THREADS, 1], period_s)
        self._address = address
        self.bytes_read = 0

    def read(self) -> CapturedFrame:
        """As ``OpenCVReader.read``. The bytes are the kernel's count on the connection, since OpenCV doesn't say."""
        frame = super().read()
        parts = urlsplit(self._address)
        counted = WireCounter(parts.port or _PORTS.get(parts.scheme, 554)).read()
        self.bytes_read = max(self.bytes_read, counted.received if counted else 0)
        return frame

    def diagnose(self) -> str:
        """Asks the server, since OpenCV doesn't say why it couldn't open the stream."""
        return diagnose(self._address)


def diagnose(address: str) -> str:
    """Why an RTSP stream can't be opened, by what the server answers to DESCRIBE."""
    parts = urlsplit(address)
    status, why = ask(address)
    if why:
        return why
    code = (*status.split(), "?")[1]
    if code in ("401", "403"):
        if parts.username is None:
            return "the camera wants a user and a password: rtsp://user:${PASSWORD}@host/path"
        return "the camera refuses this user and password"
    if code in ("404", "454"):
        return f"the camera has no stream at the path {parts.path or '/'}"
    if code.startswith("2"):
        return "the camera answers, but its stream can't be decoded; expected H.264, H.265 or MJPEG"
    return f"the camera answers with RTSP status {code}"


def ask(address: str) -> tuple[str, str]:
    """What a server answers to DESCRIBE without a user, its first lines; else "" and why it answers nothing, for people."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname or "", parts.port or _PORTS.get(parts.scheme, 554)
    except ValueError:
        host = ""
    if not host:
        return "", "the address names no host: expected rtsp://host/path"
    path = f"{parts.path}{f'?{parts.query}' if parts.query else ''}"
    url = f"{parts.scheme}://{host}:{port}{path}"
    request = f"DESCRIBE {url} RTSP/1.0\r\nCSeq: 1\r\nAccept: application/sdp\r\n\r\n"
    try:
        with socket.create_connection((host, port), _PROBE_S) as plain:
            plain.settimeout(_PROBE_S)
            with _secured(plain, parts.scheme, host) as connection:
                connection.sendall(request.encode())
                answer = connection.recv(4096).decode("latin-1")
    except TimeoutError:
        return "", f"{host}:{port} doesn't answer: check the address, the network and whether the camera is on"
    except ConnectionRefusedError:
        return "", f"{host}:{port} refuses connections: check the port, and whether RTSP is on in the camera's settings"
    except socket.gaierror:
        return "", f"the name {host} isn't known"
    except OSError as error:
        return "", f"{host}:{port} can't be reached: {error.strerror or type(error).__name__}"
    if not answer.startswith("RTSP/"):
        return "", f"{host}:{port} doesn't speak RTSP; a web page or another service answers there"
    return answer, ""


def _secured(plain: socket.socket, scheme: str, host: str) -> socket.socket:
    """The connection, encrypted if the scheme is rtsps. Cameras have certificates of their own making, so none is checked."""
    if scheme != "rtsps":
        return plain
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    return context.wrap_socket(plain, server_hostname=host)
