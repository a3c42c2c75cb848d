"""What the bus's settings take, and what they refuse."""

from __future__ import annotations

import json
import socket

import pytest
from pydantic import ValidationError

from surveilnav.bus import BusSettings
from surveilnav.bus.router import free_port, open_router
from surveilnav.bus.settings import host_and_port
from surveilnav.errors import BusError

MISTAKEN_ENDPOINTS = [
    "",
    "7447",
    "127.0.0.1:7447",
    "tcp/127.0.0.1",
    "tcp/:7447",
    "tcp/127.0.0.1:0",
    "tcp/127.0.0.1:65536",
    "tcp/127.0.0.1:99999",
    "tcp/127.0.0.1:-1",
    "tcp/::1:7447",
    "tcp/[::1:7447",
    "tcp/[x]:7447",
    "tcp/a b:7447",
    "tcp/a:7447?prio=1",
    "tcp/a:7447\n",
    "udp/127.0.0.1:7447",
    "tcp/a:٧٤٤٧",
]


@pytest.mark.parametrize(
    ("endpoint", "host", "port"),
    [("tcp/127.0.0.1:7447", "127.0.0.1", 7447), ("tcp/router:1", "router", 1), ("tcp/[::1]:65535", "::1", 65535)],
)
def test_an_endpoint_is_a_host_and_a_port(endpoint, host, port):
    assert host_and_port(endpoint) == (host, port)
    assert BusSettings(router=endpoint).router_port == port


@pytest.mark.parametrize("endpoint", MISTAKEN_ENDPOINTS)
def test_anything_else_is_refused_to_clients_and_to_the_router(endpoint):
    with pytest.raises(ValidationError, match="expected tcp/HOST:PORT"):
        BusSettings(router=endpoint)
    with pytest.raises(BusError, match="expected tcp/HOST:PORT"):
        open_router(endpoint)


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="needs IPv6")
def test_a_router_listens_at_an_ipv6_address():
    endpoint = f"tcp/[::1]:{free_port()}"
    with open_router(endpoint), pytest.raises(BusError, match="is taken"):
        open_router(endpoint)


@pytest.mark.parametrize(
    ("setting", "value"),
    [
        ("connect_timeout_s", -2),
        ("connect_timeout_s", -0.5),
        ("connect_timeout_s", 1e9),
        ("connect_timeout_s", "nan"),
        ("connect_timeout_s", "inf"),
        ("lease_ms", 0),
        ("lease_ms", -5),
        ("lease_ms", 199),
        ("lease_ms", 2**40),
    ],
)
def test_times_have_bounds(setting, value):
    with pytest.raises(ValidationError) as caught:
        BusSettings(**{setting: value})
    assert [fault["loc"] for fault in caught.value.errors()] == [(setting,)]


@pytest.mark.parametrize(("timeout_s", "timeout_ms"), [(-1, -1), (0, 0), (0.2, 200), (86_400, 86_400_000)])
def test_zenoh_is_told_how_long_to_wait(timeout_s, timeout_ms):
    made = json.loads(BusSettings(connect_timeout_s=timeout_s).client_config())
    assert made["connect"]["timeout_ms"] == timeout_ms
