"""An RTSP server as in a camera: JPEG pictures over RTP, in the connection of RTSP itself.

RTSP is RFC 2326, of which it knows what a reader needs; JPEG over RTP is RFC 2435. Most real cameras send H.264, which the tests
of the readers play. JPEG needs no encoder under a licence that a company couldn't ship.
"""

from __future__ import annotations

import asyncio
import contextlib
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from urllib.parse import urlsplit

_CLOCK_HZ, _JPEG = 90_000, 26
#: Of the standard's four Huffman tables. Tables that are fitted to a picture are shorter.
_STANDARD_HUFFMAN_BYTES = 2 * (29 + 179)
_MAX_PAYLOAD, _MAX_REQUEST_BYTES, _MAX_SIDE_PX = 1400, 8192, 2040
_SDP = "v=0\r\no=- 1 1 IN IP4 0.0.0.0\r\ns={name}\r\nt=0 0\r\nm=video 0 RTP/AVP 26\r\nc=IN IP4 0.0.0.0\r\na=control:video\r\n"


@dataclass(frozen=True, slots=True)
class JpegScan:
    """What RFC 2435 sends of a baseline JPEG.

    Attributes:
        type: 0 for 4:2:2, 1 for 4:2:0.
        tables: the quantization tables of luma and chroma, 64 bytes each.
        data: the entropy-coded scan.
    """

    type: int
    width_px: int
    height_px: int
    tables: bytes
    data: bytes

    @classmethod
    def from_jpeg(cls, jpeg: bytes) -> JpegScan:
        """Takes a JPEG apart.

        Raises:
            ValueError: it isn't of the kind that RFC 2435 can send: baseline, with the standard's Huffman tables.
        """
        tables: dict[int, bytes] = {}
        kind, size, huffman = None, (0, 0), 0
        for marker, at, content in _segments(jpeg):
            if marker == 0xDB:
                while content:
                    tables[content[0]], content = content[1:65], content[65:]
            elif marker == 0xC4:
                huffman += len(content)
            elif marker == 0xC0 and len(content) >= 8:
                height, width = struct.unpack(">HH", content[1:5])
                kind, size = {0x21: 0, 0x22: 1}.get(content[7]), (width, height)
            elif marker == 0xDA:
                if (
                    kind is None
                    or huffman != _STANDARD_HUFFMAN_BYTES
                    or sorted(tables) != [0, 1]
                    or max(size) > _MAX_SIDE_PX
                    or size[0] % 8
                    or size[1] % 8
                ):
                    break
                return cls(kind, *size, tables[0] + tables[1], jpeg[at : jpeg.rindex(b"\xff\xd9")])
        raise ValueError(
            "expected a baseline JPEG of 4:2:2 or 4:2:0 with the standard's Huffman tables, of at most 2040 pixels a side in "
            "steps of 8"
        )


def _segments(jpeg: bytes) -> Iterator[tuple[int, int, bytes]]:
    """(marker, where what follows begins, content) of each segment of the head."""
    at = 2
    while at + 4 <= len(jpeg) and jpeg[at] == 0xFF:
        length = int.from_bytes(jpeg[at + 2 : at + 4], "big")
        yield jpeg[at + 1], at + 2 + length, jpeg[at + 4 : at + 2 + length]
        at += 2 + length


def packets(scan: JpegScan, first_number: int, time_90khz: int) -> list[bytes]:
    """The RTP packets of a picture. ``first_number``: the first one's sequence number."""
    tables = struct.pack(">BBH", 0, 0, len(scan.tables)) + scan.tables
    out: list[bytes] = []
    offset = 0
    while offset < len(scan.data):
        head = struct.pack(
            ">BBHBBBB", 0, offset >> 16, offset & 0xFFFF, scan.type, 255, scan.width_px // 8, scan.height_px // 8
        )
        head += tables if offset == 0 else b""
        part = scan.data[offset : offset + _MAX_PAYLOAD - len(head)]
        offset += len(part)
        last = 0x80 if offset == len(scan.data) else 0
        number = (first_number + len(out)) & 0xFFFF
        out.append(struct.pack(">BBHII", 0x80, last | _JPEG, number, time_90khz & 0xFFFFFFFF, 1) + head + part)
    return out


class RtspServer:
    """Serves still scenes. ``run`` until it is cancelled.

    Args:
        streams: by the path without a slash, the pictures that are shown in turn.
        fps: pictures a second.
    """

    def __init__(self, streams: Mapping[str, Sequence[JpegScan]], fps: float) -> None:
        self._streams, self._fps = dict(streams), fps

    async def run(self, host: str, port: int, on_listening: Callable[[], None] = lambda: None) -> None:
        """Answers readers. ``on_listening`` is called once they can come."""
        async with await asyncio.start_server(self._serve, host, port, limit=_MAX_REQUEST_BYTES) as server:
            on_listening()
            await server.serve_forever()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        playing: asyncio.Task[None] | None = None
        channel = 0
        try:
            while (request := await _request(reader)) is not None:
                method, url, fields = request
                name = urlsplit(url).path.strip("/").split("/")[0]
                answer = _Answer(fields.get("cseq", "0"))
                if name not in self._streams and method != "OPTIONS":
                    writer.write(answer.text("404 Not Found"))
                elif method == "DESCRIBE":
                    writer.write(answer.text("200 OK", f"Content-Base: {url}/", body=_SDP.format(name=name)))
                elif method == "SETUP" and "RTP/AVP/TCP" not in fields.get("transport", ""):
                    writer.write(answer.text("461 Unsupported Transport"))
                elif method == "SETUP":
                    channel = _channel(fields["transport"])
                    say = f"Transport: RTP/AVP/TCP;unicast;interleaved={channel}-{channel + 1}"
                    writer.write(answer.text("200 OK", "Session: 1;timeout=60", say))
                else:
                    allowed = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN, GET_PARAMETER"
                    writer.write(answer.text("200 OK", "Session: 1;timeout=60", allowed))
                    if method == "PLAY" and playing is None:
                        playing = asyncio.create_task(self._play(writer, self._streams[name], channel))
                    elif method == "TEARDOWN":
                        break
                await writer.drain()
        except (ConnectionError, ValueError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            pass  # the reader has gone, or speaks something else
        finally:
            if playing is not None:
                playing.cancel()
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()

    async def _play(self, writer: asyncio.StreamWriter, scans: Sequence[JpegScan], channel: int) -> None:
        loop, number, shown = asyncio.get_running_loop(), 0, 0
        began_s = loop.time()
        with contextlib.suppress(ConnectionError):
            while True:
                made = packets(scans[shown % len(scans)], number, round(shown / self._fps * _CLOCK_HZ))
                writer.write(b"".join(b"$" + struct.pack(">BH", channel, len(packet)) + packet for packet in made))
                await writer.drain()
                number += len(made)
                # a reader that was slow gets the next picture, not all that it missed
                shown = max(shown + 1, int((loop.time() - began_s) * self._fps))
                await asyncio.sleep(max(0.0, began_s + shown / self._fps - loop.time()))


@dataclass(frozen=True, slots=True)
class _Answer:
    cseq: str

    def text(self, status: str, *fields: str, body: str = "") -> bytes:
        lines = [f"RTSP/1.0 {status}", f"CSeq: {self.cseq}", *fields]
        if body:
            lines += ["Content-Type: application/sdp", f"Content-Length: {len(body)}"]
        return ("\r\n".join(lines) + "\r\n\r\n" + body).encode()


def _channel(transport: str) -> int:
    """The first channel of ``interleaved=0-1``."""
    _, _, after = transport.partition("interleaved=")
    return int(after.split("-")[0].split(";")[0] or 0) & 0xFF


async def _request(reader: asyncio.StreamReader) -> tuple[str, str, dict[str, str]] | None:
    """(method, URL, header fields in lower case) of the next request; None at the end. What RTCP says is left out."""
    while first := await reader.read(1):
        if first == b"$":
            _, length = struct.unpack(">BH", await reader.readexactly(3))
            await reader.readexactly(length)
            continue
        lines = (first + await reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
        method, url, _ = lines[0].split(" ", 2)
        fields = (line.partition(":") for line in lines[1:] if line)
        return method, url, {name.strip().lower(): value.strip() for name, _, value in fields}
    return None
