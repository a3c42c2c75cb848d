"""Which Host headers are for this gateway."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from services.gateway.config import GatewaySettings
from services.gateway.core.hosts import allowed_names, foreign

LOOPBACK = "localhost,127.0.0.1,[::1]"


@pytest.mark.parametrize(
    "host", ["localhost", "localhost:8080", "LocalHost:1", "localhost.:80", "127.0.0.1:8080", "[::1]:8080", "[::1]"]
)
def test_loopback_is_answered_with_any_port(host):
    assert foreign([host], allowed_names(LOOPBACK, "127.0.0.1")) is None


@pytest.mark.parametrize(
    "host",
    [
        "evil.example", "evil.example:8080", "localhost.evil.example", "evil.localhost", "127.0.0.1.evil.example", "::1",
        "localhost:8080:8080", "localhost:x", "localhost@evil.example", "localhost/", "[", "[::1", "[::1]evil", "", ":8080",
        "localhost,evil.example", " localhost", "localhost\n", "127.1", "0.0.0.0:8080", "\udcff",
    ],
)  # fmt: skip
def test_any_other_is_named(host):
    assert foreign([host], allowed_names(LOOPBACK, "0.0.0.0")) == host
    assert foreign(["localhost", host], allowed_names(LOOPBACK, "0.0.0.0")) == host


def test_a_request_for_nobody_is_foreign():
    assert foreign([], allowed_names(LOOPBACK, "127.0.0.1")) == ""


@pytest.mark.parametrize(
    ("listed", "listens_at", "host"),
    [
        ("building.example, localhost", "0.0.0.0", "Building.example:443"),
        ("::1", "0.0.0.0", "[::1]:80"),
        ("localhost", "192.168.1.4", "192.168.1.4:8080"),
        ("", "fd00::5", "[FD00::5]:8080"),
        ("localhost,*", "0.0.0.0", "evil.example"),
    ],
)
def test_more_names_by_the_settings_and_the_address_listened_at(listed, listens_at, host):
    assert foreign([host], allowed_names(listed, listens_at)) is None


def test_listening_at_every_address_allows_none_of_them():
    assert allowed_names("localhost", "0.0.0.0") == allowed_names("localhost", "::") == {"localhost"}


@pytest.mark.parametrize("entry", ["http://localhost", "a b", "[x]", "*.example.org"])
def test_an_entry_that_is_no_name_is_a_mistake_in_the_settings(entry):
    with pytest.raises(ValidationError, match="expected names such as"):
        GatewaySettings(allowed_hosts=f"localhost,{entry}")
