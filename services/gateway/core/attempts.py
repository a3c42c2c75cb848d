"""Limits how often a client may present a wrong key."""

from __future__ import annotations

from collections import OrderedDict, deque
from ipaddress import ip_address, ip_network

#: So many wrong keys in so long; then that client is refused until the oldest is so old.
MAX_FAILURES, WINDOW_S = 10, 60.0
_MAX_CLIENTS = 10_000


class FailedAttempts:
    """When each client presented a wrong key. Times are of any one clock [s]. Not thread-safe."""

    def __init__(self) -> None:
        self._failed_s: OrderedDict[str, deque[float]] = OrderedDict()

    def wait_s(self, client: str, now_s: float) -> float:
        """How long a client must wait before another key of it is looked at; 0: not at all."""
        times = self._failed_s.get(_group(client))
        if times is None or len(times) < MAX_FAILURES:
            return 0.0
        return max(0.0, times[0] + WINDOW_S - now_s)

    def record_failure(self, client: str, now_s: float) -> None:
        """Records that a client presented a wrong key."""
        group = _group(client)
        times = self._failed_s.setdefault(group, deque(maxlen=MAX_FAILURES))
        times.append(now_s)
        self._failed_s.move_to_end(group)
        while len(self._failed_s) > _MAX_CLIENTS:
            self._failed_s.popitem(last=False)


def _group(client: str) -> str:
    """Whose failures are counted together: an IPv4 address, or the /64 network of an IPv6 one, which belongs to one client."""
    try:
        address = ip_address(client)
    except ValueError:
        return client
    return str(ip_network((address, 64), strict=False)) if address.version == 6 else client
