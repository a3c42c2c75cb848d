"""How a process reaches the bus: environment variables ``SURVEILNAV_BUS__<FIELD>``; and Zenoh's configuration."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID_PATTERN

DEFAULT_PORT = 7447
#: Size limit of a message with its payload; a floor's full point cloud has 48 MB. The router drops larger ones.
MAX_MESSAGE_BYTES = 64 * 2**20
_RECEIVE = {"max_message_size": MAX_MESSAGE_BYTES + 2**16}  # includes the key and Zenoh's own headers
#: How long bulk data waits for the message before it, in a process and in the router [ms]; then it is left out
#: (docs/results/bus.md). A process may wait for its own messages. The router serves everybody, so at each link it waits only
#: as long as a burst of frames takes.
_PROCESS_WAIT_MS, _ROUTER_WAIT_MS = 5000, 50
#: Lease of the router, and the default for processes.
_LEASE_MS = 2000
#: Keep-alive messages per lease; Zenoh's default is 4. Their interval (0.1 s) is also how long the router tries to send what
#: it still has for a reader that is gone, while senders to that reader wait.
_ROUTER_KEEP_ALIVE = 20
_ENDPOINT = re.compile(r"tcp/(?P<host>\[[0-9A-Fa-f:.]+\]|[^][:/?#\s]+):(?P<port>[0-9]{1,5})")


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Host (an IPv6 address without brackets) and port of an endpoint.

    Raises:
        ValueError: it isn't ``tcp/HOST:PORT``.
    """
    match = _ENDPOINT.fullmatch(endpoint)
    if not match or not 0 < int(match["port"]) < 65536:
        raise ValueError(
            f"expected tcp/HOST:PORT with a port from 1 to 65535, such as tcp/127.0.0.1:{DEFAULT_PORT} or "
            f"tcp/[::1]:{DEFAULT_PORT}"
        )
    return match["host"].strip("[]"), int(match["port"])


class BusSettings(BaseSettings):
    """Where the router is, and how this process logs and reports its health."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_BUS__", extra="ignore")

    router: str = Field(f"tcp/127.0.0.1:{DEFAULT_PORT}", description="the router's endpoint, tcp/HOST:PORT")
    building: str = Field("building", pattern=ID_PATTERN, description="the building's name in every key")
    connect_timeout_s: float = Field(
        30.0,
        ge=-1,
        le=86_400,
        description="how long a process waits for the router when it starts; 0: it tries once, -1: it waits for ever",
    )
    lease_ms: int = Field(
        _LEASE_MS, ge=200, le=60_000, description="a process that has been silent for this long counts as gone"
    )
    health_file: Path | None = Field(
        None, description="a file that is touched every second while the service is healthy"
    )
    log_format: Literal["console", "json"] = Field("console", description="how a log line is written")
    log_level: Literal["debug", "info", "warning", "error"] = Field(
        "info", description="less important log lines are left out"
    )

    @field_validator("router")
    @classmethod
    def _check_endpoint(cls, value: str) -> str:
        host_and_port(value)
        return value

    @field_validator("connect_timeout_s")
    @classmethod
    def _check_timeout(cls, value: float) -> float:
        if -1 < value < 0:
            raise ValueError("expected seconds from 0, or -1 to wait for ever")
        return value

    @property
    def router_port(self) -> int:
        """The TCP port of the router's endpoint."""
        return host_and_port(self.router)[1]

    def client_config(self) -> str:
        """Zenoh's configuration (JSON5) for a client of one router.

        There are two links, so that bulk data doesn't delay commands (7 ms instead of 92 ms). Shared memory is off, because it
        would hide bytes from the kernel's counters.
        """
        links = [f"{self.router}?prio=1-4", f"{self.router}?prio=5-7"]
        return json.dumps(
            {
                "mode": "client",
                "connect": {
                    "endpoints": [{"strategy": "allOf", "locators": links}],
                    "timeout_ms": -1 if self.connect_timeout_s < 0 else int(self.connect_timeout_s * 1000),
                    "retry": {"period_init_ms": 200, "period_max_ms": 500},
                },
                "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
                "transport": _transport(self.lease_ms, _PROCESS_WAIT_MS),
            }
        )


def _transport(lease_ms: int, wait_ms: int, **sending: int) -> dict[str, object]:
    """Zenoh's ``transport``. For BLOCK_FIRST, ``wait_before_drop`` [us] is the time that a message waits for the one before."""
    queue = {"congestion_control": {"drop": {"wait_before_drop": wait_ms * 1000}}}
    return {
        "shared_memory": {"enabled": False},
        "unicast": {"max_links": 4},
        "link": {"tx": {"lease": lease_ms, "queue": queue, **sending}, "rx": _RECEIVE},
    }


def router_config(listen: str) -> str:
    """Zenoh's configuration (JSON5) for the router; zenohd takes the same. Without scouting, it needs no delay at the start."""
    return json.dumps(
        {
            "mode": "router",
            "listen": {"endpoints": [listen]},
            "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "adminspace": {"enabled": True},
            "transport": _transport(_LEASE_MS, _ROUTER_WAIT_MS, keep_alive=_ROUTER_KEEP_ALIVE),
        }
    )
