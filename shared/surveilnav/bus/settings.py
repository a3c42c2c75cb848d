"""How a process reaches the bus: environment variables ``SURVEILNAV_BUS__<FIELD>``; and Zenoh's configuration."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field, field_validator, model_validator
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.bus.tls import TlsFiles
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
_ENDPOINT = re.compile(r"(?P<protocol>tcp|tls)/(?P<host>\[[0-9A-Fa-f:.]+\]|[^][:/?#\s]+):(?P<port>[0-9]{1,5})")


def host_and_port(endpoint: str) -> tuple[str, int]:
    """Host (an IPv6 address without brackets) and port of an endpoint.

    Raises:
        ValueError: it is neither ``tcp/HOST:PORT`` nor ``tls/HOST:PORT``.
    """
    match = _ENDPOINT.fullmatch(endpoint)
    if not match or not 0 < int(match["port"]) < 65536:
        raise ValueError(
            f"expected tcp/HOST:PORT or tls/HOST:PORT with a port from 1 to 65535, such as tcp/127.0.0.1:{DEFAULT_PORT} or "
            f"tls/[::1]:{DEFAULT_PORT}"
        )
    return match["host"].strip("[]"), int(match["port"])


def is_encrypted(endpoint: str) -> bool:
    """Whether an endpoint is one of TLS."""
    return endpoint.startswith("tls/")


class BusSettings(BaseSettings):
    """Where the router is, and how this process logs and reports its health."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_BUS__", extra="ignore")

    router: str = Field(
        f"tcp/127.0.0.1:{DEFAULT_PORT}",
        description="the router's endpoint, tcp/HOST:PORT, or tls/HOST:PORT with an identity",
    )
    building: str = Field("building", pattern=ID_PATTERN, description="the building's name in every key")
    tls_ca: Path | None = Field(None, description="with tls/: the file ca.pem of this process's identity")
    tls_certificate: Path | None = Field(
        None, description="with tls/: the file certificate.pem, which says who this process is"
    )
    tls_key: Path | None = Field(None, description="with tls/: the file key.pem, which only its owner may read")
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
    handover_folder: Path | None = Field(
        None,
        description="a folder in memory that processes of one machine see: in it they hand each other pictures, maps and "
        "recordings, which then don't cross the bus; not set: everything is sent",
    )
    handover_mb: int = Field(48, ge=1, le=65_536, description="MB in that folder; the oldest make room")
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

    @model_validator(mode="after")
    def _check_tls(self) -> BusSettings:
        given = [self.tls_ca, self.tls_certificate, self.tls_key]
        names = "SURVEILNAV_BUS__TLS_CA, SURVEILNAV_BUS__TLS_CERTIFICATE and SURVEILNAV_BUS__TLS_KEY"
        if is_encrypted(self.router) and None in given:
            raise ValueError(f"a router at tls/HOST:PORT needs {names}: the files of an identity")
        if not is_encrypted(self.router) and any(given):
            raise ValueError(f"with {names} the router's endpoint is tls/HOST:PORT: this one isn't encrypted")
        return self

    @property
    def tls_files(self) -> TlsFiles | None:
        """The files of this process's identity; None: the bus has no security."""
        if self.tls_ca is None or self.tls_certificate is None or self.tls_key is None:
            return None
        return TlsFiles(self.tls_ca, self.tls_certificate, self.tls_key)

    @property
    def router_port(self) -> int:
        """The TCP port of the router's endpoint."""
        return host_and_port(self.router)[1]

    def client_config(self) -> str:
        """Zenoh's configuration (JSON5) for a client of one router.

        Shared memory is off, because it would hide bytes from the kernel's counters.
        """
        return json.dumps(
            {
                "mode": "client",
                "connect": {
                    "endpoints": [self.router],
                    "timeout_ms": -1 if self.connect_timeout_s < 0 else int(self.connect_timeout_s * 1000),
                    "retry": {"period_init_ms": 200, "period_max_ms": 500},
                },
                "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
                "transport": _transport(self.lease_ms, _PROCESS_WAIT_MS, self.tls_files),
            }
        )


#: Zenoh lets a router have 1,000 sessions, and 100 that are just being opened. A building may have more cameras than that, and
#: all of them come back at once when the router restarts.
#: More than one link for a session would let Zenoh mix up keys, see ``Connection``.
_UNICAST = {"max_links": 1, "max_sessions": 20_000, "accept_pending": 2_000}


def _transport(lease_ms: int, wait_ms: int, files: TlsFiles | None, **sending: int) -> dict[str, object]:
    """Zenoh's ``transport``. For BLOCK_FIRST, ``wait_before_drop`` [us] is the time that a message waits for the one before."""
    queue = {"congestion_control": {"drop": {"wait_before_drop": wait_ms * 1000}}}
    link: dict[str, object] = {"tx": {"lease": lease_ms, "queue": queue, **sending}, "rx": _RECEIVE}
    if files is not None:
        link |= {"protocols": ["tls"], "tls": files.zenoh_config()}
    return {"shared_memory": {"enabled": False}, "unicast": _UNICAST, "link": link}


def router_config(
    listen: str,
    files: TlsFiles | None = None,
    access: dict[str, object] | None = None,
    connect: Sequence[str] = (),
) -> str:
    """Zenoh's configuration (JSON5) for the router; zenohd takes the same. Without scouting, it needs no delay at the start.

    Args:
        files: the router's identity; None: no security.
        access: Zenoh's ``access_control``; see ``surveilnav.security.access``.
        connect: endpoints of other routers that it joins, and joins again when they come back.
    """
    join: dict[str, object] = {"endpoints": list(connect), "retry": {"period_init_ms": 200, "period_max_ms": 2000}}
    return json.dumps(
        {
            "mode": "router",
            "listen": {"endpoints": [listen]},
            **({"connect": join} if connect else {}),
            "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
            "adminspace": {"enabled": True},
            "transport": _transport(_LEASE_MS, _ROUTER_WAIT_MS, files, keep_alive=_ROUTER_KEEP_ALIVE),
            **({"access_control": access} if access is not None else {}),
        }
    )
