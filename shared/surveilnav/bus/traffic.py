"""Traffic figures of a process: bytes offered (published), delivered (received), and on the wire (counted by the kernel).

Offered and delivered bytes are payload, attachment and key. For bulk data they agree with the kernel's count within 0.01 %;
the difference is headers and keep-alives. The kernel's count is read from the process's own sockets (TCP_INFO), which needs
no tool and no privilege.
"""

from __future__ import annotations

import math
import os
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from functools import reduce
from typing import Literal, NamedTuple

from surveilnav.messages import TrafficRow

#: Number of keys that are counted separately; 1,000 cameras have 13,000. All others are counted together.
_MAX_ROWS = 20_000
#: So often a ``WireCounter`` looks which sockets there are.
_LOOK_S = 1.0
#: So often all rows are published.
_ALL_ROWS_S = 300.0
OTHER_KEYS = "(other keys)"

Direction = Literal["offered", "delivered", "replaced"]
# Where numbers stand in TCP_INFO (linux/tcp.h, kernel >= 4.19): bytes_sent (retransmissions included), bytes_received and
# bytes_acked; and snd_mss and min_rtt, which is in microseconds.
_TCP_INFO_BYTES = 200, 128, 120
_TCP_INFO_NUMBERS = 16, 148
_TCP_INFO_LENGTH = 208
_UNKNOWN = 2**32 - 1


class TrafficMeter:
    """Counts messages and bytes per key. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._messages: Counter[tuple[str, Direction]] = Counter()
        self._bytes: Counter[tuple[str, Direction]] = Counter()
        self._rejected: Counter[str] = Counter()
        self._tier_bytes: Counter[str] = Counter()
        self._unsent: Counter[str] = Counter()

    def count(self, key: str, direction: Direction, n_bytes: int) -> None:
        """Counts one message of ``n_bytes`` (payload, attachment and key)."""
        with self._lock:
            if (key, direction) not in self._bytes and len(self._bytes) >= _MAX_ROWS:
                key = OTHER_KEYS  # invented keys must not fill the memory
            self._messages[key, direction] += 1
            self._bytes[key, direction] += n_bytes

    def reject(self, reason: str) -> int:
        """Counts data that was dropped; returns how often for this reason."""
        with self._lock:
            self._rejected[reason] += 1
            return self._rejected[reason]

    def count_frame(self, tier: str, n_bytes: int) -> None:
        """Counts a frame of a camera by its tier, beside its key."""
        with self._lock:
            self._tier_bytes[tier] += n_bytes

    def count_unsent(self, reason: str) -> None:
        """Counts a frame of a camera that won't be sent, because a newer one of its view took its place."""
        with self._lock:
            self._unsent[reason] += 1

    def tier_bytes(self) -> dict[str, int]:
        """Bytes of frames so far, by tier."""
        with self._lock:
            return dict(self._tier_bytes)

    def unsent(self) -> dict[str, int]:
        """How many frames weren't sent, by reason."""
        with self._lock:
            return dict(self._unsent)

    def rows(self) -> list[TrafficRow]:
        """Messages and bytes so far, by key and direction."""
        with self._lock:
            return [
                TrafficRow(key, direction, self._messages[key, direction], n_bytes)
                for (key, direction), n_bytes in sorted(self._bytes.items())
            ]

    def rejected(self) -> dict[str, int]:
        """How often data was dropped, by reason."""
        with self._lock:
            return dict(self._rejected)

    def offered_bytes(self, key: str) -> int:
        with self._lock:
            return self._bytes[key, "offered"]


class ReportedRows:
    """What the others know of a node's rows, so that only what has changed is published. All of it is again from time to time:
    a recording may begin at any moment."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, str], int] = {}
        self._all_s = -math.inf

    def news(self, rows: list[TrafficRow], now_s: float) -> tuple[list[TrafficRow], bool]:
        """The rows to publish now, and whether they are only a part."""
        is_partial = now_s - self._all_s < _ALL_ROWS_S
        if not is_partial:
            self._all_s, self._known = now_s, {}
        changed = [row for row in rows if self._known.get((row.key, row.direction)) != row.n_bytes]
        self._known |= {(row.key, row.direction): row.n_bytes for row in changed}
        return changed, is_partial


class WireBytes(NamedTuple):
    """What the kernel has counted on this process's TCP connections to the router.

    Attributes:
        sent: bytes that were sent, retransmissions included. ``received``: bytes that came.
        acknowledged: bytes of which the router's side has said that they arrived.
        segment_bytes: the most that one packet holds. The last packet of a message is often acknowledged 40 ms late.
        round_trip_s: the shortest time in which a packet was acknowledged.
        queued: bytes that the kernel has and that aren't acknowledged yet: they wait, or are under way.
    """

    sent: int
    received: int
    acknowledged: int
    segment_bytes: int
    round_trip_s: float
    queued: int


class WireCounter:
    """Reads the kernel's counts on this process's TCP sockets to a remote port, such as the router's. Thread-safe."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._found: tuple[int, ...] = ()
        self._looked_s = -math.inf

    def read(self) -> WireBytes | None:
        """The counts so far; None without /proc, or without such a socket."""
        now_s = time.monotonic()
        found: list[WireBytes | None] = [None]
        if (
            now_s - self._looked_s < _LOOK_S
        ):  # which ones there are is seldom news, and takes ten times as long to find out
            found = [_counts_of(descriptor, self._port) for descriptor in self._found]
        if None in found:
            counted = {descriptor: _counts_of(descriptor, self._port) for descriptor in _sockets()}
            self._found = tuple(descriptor for descriptor, counts in counted.items() if counts is not None)
            self._looked_s = now_s if self._found else -math.inf  # they are connected again at any moment
            found = [counts for counts in counted.values() if counts is not None]
        return reduce(_sum, (counts for counts in found if counts is not None)) if found else None


def _sockets() -> Iterator[int]:
    """The descriptors of this process that are sockets; none without /proc."""
    try:
        descriptors = os.listdir("/proc/self/fd")
    except OSError:
        return
    for name in descriptors:
        with suppress(OSError):  # closed meanwhile
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):
                yield int(name)


def _counts_of(descriptor: int, port: int) -> WireBytes | None:
    """The counts on a socket that is connected to a remote port; None: it isn't, or not any more.

    The descriptor is another thread's, which may close it meanwhile, and open a file under the same number. So it is neither
    copied nor closed here: a copy would keep the file open, and closing one would release the process's locks on it.
    """
    import fcntl  # only where there is /proc
    import termios

    sock = None
    try:
        sock = socket.socket(fileno=descriptor)
        if sock.type != socket.SOCK_STREAM or sock.family not in (socket.AF_INET, socket.AF_INET6):
            return None
        if sock.getpeername()[1] != port:
            return None
        info = sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, 256)
        queued = fcntl.ioctl(descriptor, termios.TIOCOUTQ, b"\0" * 4)
    except OSError:
        return None
    finally:
        if sock is not None:
            sock.detach()
    if len(info) < _TCP_INFO_LENGTH:
        return None
    sent, received, acknowledged = (struct.unpack_from("<Q", info, at)[0] for at in _TCP_INFO_BYTES)
    segment_bytes, min_rtt_us = (struct.unpack_from("<I", info, at)[0] for at in _TCP_INFO_NUMBERS)
    round_trip_s = 1e-6 * min_rtt_us if min_rtt_us != _UNKNOWN else 0.0
    return WireBytes(sent, received, acknowledged, segment_bytes, round_trip_s, struct.unpack("i", queued)[0])


def _sum(one: WireBytes, other: WireBytes) -> WireBytes:
    return WireBytes(
        sent=one.sent + other.sent,
        received=one.received + other.received,
        acknowledged=one.acknowledged + other.acknowledged,
        segment_bytes=max(one.segment_bytes, other.segment_bytes),
        round_trip_s=max(one.round_trip_s, other.round_trip_s),
        queued=one.queued + other.queued,
    )
