"""Pictures over HTTP: an MJPEG stream, or a single picture that is asked for again and again."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from urllib.parse import unquote, urlsplit, urlunsplit

import cv2
import httpx
import numpy as np

from surveilnav.services.camera_node.sources.readers.reader import CapturedFrame, StreamError

_TIMEOUT_S = 10.0
_MAX_PICTURE_BYTES = 32 << 20
_BEGIN, _END = b"\xff\xd8\xff", b"\xff\xd9"
_LENGTH = re.compile(rb"content-length:\s*(\d{1,9})", re.IGNORECASE)


class HttpReader:
    """Reads ``http://`` or ``https://``: what answers decides whether it is a stream (multipart) or a single picture.

    Attributes:
        bytes_read: bytes of pictures that have come.
    """

    def __init__(self, address: str, period_s: float) -> None:
        self._address, self._user, self._password = _without_user(address)
        self._period_s = period_s
        self._client: httpx.Client | None = None
        self._response: httpx.Response | None = None
        self._pictures: Iterator[bytes] | None = None
        self._last_s = -1e9
        self.bytes_read = 0

    def open(self) -> None:
        """Asks for the address. Raises StreamError if pictures don't come."""
        # Cameras have certificates of their own making, so none is checked.
        self._client = httpx.Client(timeout=_TIMEOUT_S, verify=False, follow_redirects=True)
        response = self._get()
        kind = response.headers.get("content-type", "").split(";")[0].strip().lower()
        if kind == "multipart/x-mixed-replace":
            self._response, self._pictures = response, self._parts(response)
        elif kind.startswith("image/"):
            response.close()
        else:
            response.close()
            self.close()
            got = f"{kind} (a web page)" if kind == "text/html" else kind or "something without a type"
            raise StreamError(f"expected pictures (multipart/x-mixed-replace or image/...), got {got}")

    def read(self) -> CapturedFrame:
        """Waits for the next picture."""
        while True:
            data = self._next()
            now_s = time.monotonic()
            if now_s - self._last_s >= self._period_s:
                break
        self._last_s = now_s
        bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        if bgr is None:
            raise StreamError("a picture can't be decoded")
        return CapturedFrame(np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8), time.time_ns(), "arrival")

    def close(self) -> None:
        """Closes the connection."""
        response, self._response, self._pictures = self._response, None, None
        client, self._client = self._client, None
        for opened in (response, client):
            if opened is not None:
                opened.close()

    def _next(self) -> bytes:
        try:
            if self._pictures is not None:
                data = next(self._pictures, None)
                if data is None:
                    raise StreamError("the stream has ended")
            else:
                time.sleep(max(0.0, self._last_s + self._period_s - time.monotonic()))
                response = self._get()
                try:
                    data = b"".join(self._limited(response))
                finally:
                    response.close()
        except httpx.HTTPError as error:
            raise StreamError(f"the connection broke: {type(error).__name__}") from None
        self.bytes_read += len(data)
        return data

    def _get(self) -> httpx.Response:
        """The answer, with its body yet to be read. Cameras want the user as Digest or as Basic, so both are tried."""
        if self._client is None:
            raise StreamError("it is closed")
        methods: list[httpx.Auth | None] = [None]
        if self._user:
            methods = [httpx.DigestAuth(self._user, self._password), httpx.BasicAuth(self._user, self._password)]
        try:
            for auth in methods:
                response = self._client.send(self._client.build_request("GET", self._address), stream=True, auth=auth)
                if response.status_code != 401:
                    break
                response.close()
        except httpx.ConnectError:
            raise StreamError("the camera can't be reached: check the address and the network") from None
        except httpx.HTTPError as error:
            raise StreamError(f"the camera doesn't answer: {type(error).__name__}") from None
        if response.status_code == 401:
            wants = "refuses this user and password" if self._user else "wants a user and a password in the address"
            raise StreamError(f"the camera {wants}")
        if response.status_code != 200:
            response.close()
            raise StreamError(f"the camera answers with HTTP status {response.status_code}")
        return response

    def _limited(self, response: httpx.Response) -> Iterator[bytes]:
        n_bytes = 0
        for chunk in response.iter_bytes():
            n_bytes += len(chunk)
            if n_bytes > _MAX_PICTURE_BYTES:
                raise StreamError(f"a picture has more than {_MAX_PICTURE_BYTES >> 20} MiB")
            yield chunk

    def _parts(self, response: httpx.Response) -> Iterator[bytes]:
        """The JPEG pictures of a multipart stream: by the length in a part's header, or else by JPEG's own markers.

        Boundaries aren't used, since not all cameras write them right.
        """
        buffer = b""
        for chunk in response.iter_bytes():
            buffer += chunk
            while (end := _picture_end(buffer)) is not None:
                yield buffer[buffer.find(_BEGIN) : end]
                buffer = buffer[end:]
            if len(buffer) > _MAX_PICTURE_BYTES:
                raise StreamError(f"a picture has more than {_MAX_PICTURE_BYTES >> 20} MiB")


def _picture_end(buffer: bytes) -> int | None:
    """Where the first picture in a buffer ends; None if more of it has to come.

    Without a length a picture ends at the first end marker. Where a thumbnail is embedded that is too early.
    """
    begin = buffer.find(_BEGIN)
    if begin < 0:
        return None
    if (length := _LENGTH.search(buffer, 0, begin)) is not None:
        end = begin + int(length.group(1))
        return end if end <= len(buffer) else None
    end = buffer.find(_END, begin + len(_BEGIN))
    return None if end < 0 else end + len(_END)


def _without_user(address: str) -> tuple[str, str, str]:
    """The address without its user and password, and these."""
    parts = urlsplit(address)
    host = parts.netloc.rpartition("@")[2]
    bare = urlunsplit((parts.scheme, host, parts.path, parts.query, ""))
    return bare, unquote(parts.username or ""), unquote(parts.password or "")
