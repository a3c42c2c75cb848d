"""How a service reaches the bus. Every field is an environment variable ``SURVEILNAV_BUS__<FIELD>``."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.contract import ID_PATTERN

DEFAULT_PORT = 7447
#: The largest message, payload and header: a floor's full cloud has 48 MB. The router drops what is larger.
MAX_MESSAGE_BYTES = 64 * 2**20
_RECEIVE = {"max_message_size": MAX_MESSAGE_BYTES + 2**16}  # with the key and what Zenoh adds
#: How long bulk data waits for the message before it [ms], then it is left out (docs/results/bus.md). A process waits for
#: its own messages. The router is everybody's: at one reader's link it waits just as long as a burst of frames takes.
_OWN_TURN_MS, _ROUTER_TURN_MS = 5000, 50
#: Of the router, and of whoever doesn't say another.
_LEASE_MS = 2000
#: Signs of life a lease; Zenoh has 4. One's interval (0.1 s) is also how long the router tries to get rid of what it still
#: has for a reader that is gone, and whoever sent to it waits meanwhile.
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
    """Where the router is, and what is said of this process."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_BUS__", extra="ignore")

    router: str = Field(f"tcp/127.0.0.1:{DEFAULT_PORT}", description="the router's endpoint, tcp/HOST:PORT")
    building: str = Field("building", pattern=ID_PATTERN, description="the building's name in every key")
    connect_timeout_s: float = Field(
        30.0, ge=-1, le=86_400, description="how long to wait for the router at start; 0: one try, -1: for ever"
    )
    lease_ms: int = Field(_LEASE_MS, ge=200, le=60_000, description="a peer silent for so long counts as gone")
    health_file: Path | None = Field(None, description="touched every second while the service is healthy")
    log_format: Literal["console", "json"] = Field("console", description="how a log line is written")
    log_level: Literal["debug", "info", "warning", "error"] = Field("info", description="lines below it are left out")

    @field_validator("router")
    @classmethod
    def _endpoint(cls, value: str) -> str:
        host_and_port(value)
        return value

    @field_validator("connect_timeout_s")
    @classmethod
    def _for_ever_or_so_long(cls, value: float) -> float:
        if -1 < value < 0:
            raise ValueError("expected seconds from 0, or -1 to wait for ever")
        return value

    @property
    def router_port(self) -> int:
        """The TCP port of the router's endpoint."""
        return host_and_port(self.router)[1]

    def client_config(self) -> str:
        """Zenoh's JSON5 for a client: one router, no scouting, no shared memory (it hides bytes from the
        kernel's counters), two links so that bulk data never delays a command (notes: 7 ms against 92 ms).
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
                "transport": _transport(self.lease_ms, _OWN_TURN_MS),
            }
        )


def _transport(lease_ms: int, turn_ms: int, **sending: int) -> dict[str, object]:
    """Zenoh's ``transport``. Its microseconds before a drop are, for BLOCK_FIRST, the wait for the message before."""
    queue = {"congestion_control": {"drop": {"wait_before_drop": turn_ms * 1000}}}
    return {
        "shared_memory": {"enabled": False},
        "unicast": {"max_links": 4},
        "link": {"tx": {"lease": lease_ms, "queue": queue, **sending}, "rx": _RECEIVE},
    }


def router_config(listen: str) -> str:
    """Zenoh's JSON5 for the router (zenohd takes the same). It scouts for nobody, so it doesn't wait for anybody either."""
    return json.dumps(
        {
            "mode": "router",
            "listen": {"endpoints": [listen]},
            "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "adminspace": {"enabled": True},
            "transport": _transport(_LEASE_MS, _ROUTER_TURN_MS, keep_alive=_ROUTER_KEEP_ALIVE),
        }
    )
