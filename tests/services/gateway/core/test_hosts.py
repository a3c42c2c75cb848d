"""Which Host headers are for this gateway, and which client asks where trusted proxies stand between."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from surveilnav.services.gateway.config import GatewaySettings
from surveilnav.services.gateway.core.hosts import client_address, foreign_host, foreign_origin, networks


def names(host="127.0.0.1", **settings):
    return GatewaySettings(host=host, **settings).names


@pytest.mark.parametrize(
    "host", ["localhost", "localhost:8080", "LocalHost:1", "localhost.:80", "127.0.0.1:8080", "[::1]:8080", "[0:0::1]"]
)
def test_loopback_is_answered_with_any_port(host):
    assert foreign_host([host], names()) is None


@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8080",
        "localhost.evil.example",
        "evil.localhost",
        "127.0.0.1.evil.example",
        "::1",
        "localhost:8080:8080",
        "localhost:x",
        "localhost@evil.example",
        "localhost/",
        "[",
        "[::1",
        "[::1]evil",
        "",
        ":8080",
        "localhost,evil.example",
        " localhost",
        "localhost\n",
        "127.1",
        "0.0.0.0:8080",
        "\udcff",
    ],
)
def test_any_other_is_named(host):
    assert foreign_host([host], names("0.0.0.0")) == host
    assert foreign_host(["localhost", host], names("0.0.0.0")) == host


def test_a_request_for_nobody_is_foreign_host():
    assert foreign_host([], names()) == ""


@pytest.mark.parametrize(
    ("listed", "listens_at", "host"),
    [
        ("building.example, localhost", "0.0.0.0", "Building.example:443"),
        ("::1", "0.0.0.0", "[::1]:80"),
        ("localhost", "192.168.1.4", "192.168.1.4:8080"),
        ("", "fd00::5", "[FD00::5]:8080"),
        ("localhost", "[fd00:0::5]", "[fd00::5]:8080"),
        ("localhost", "fe80::1%eth0", "[fe80::1]:8080"),
        ("localhost", "Building.example", "building.example"),
        ("localhost,*", "0.0.0.0", "evil.example"),
    ],
)
def test_more_names_by_the_settings_and_the_address_listened_at(listed, listens_at, host):
    assert foreign_host([host], names(listens_at, allowed_hosts=listed)) is None


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "[::]", "[0:0::0]", ""])
def test_listening_at_every_address_allows_none_of_them(host):
    assert names(host, allowed_hosts="localhost") == {"localhost"}


@pytest.mark.parametrize(
    ("written", "host"), [("[::1]", "::1"), ("[::]", "::"), ("FD00::5", "fd00::5"), ("pc.lan", "pc.lan")]
)
def test_an_address_to_listen_at_may_stand_in_brackets(written, host):
    assert GatewaySettings(host=written).host == host


@pytest.mark.parametrize(
    ("setting", "value", "words"),
    [
        ("host", "127.0.0.1:8080", "without a port"),
        ("host", "[::1]:8080", "without a port"),
        ("host", "[127.0.0.1]", "such as 127.0.0.1, ::1"),
        ("host", "http://localhost", "such as 127.0.0.1, ::1"),
        ("allowed_hosts", "localhost,http://localhost", "expected names such as"),
        ("allowed_hosts", "a b", "expected names such as"),
        ("allowed_hosts", "[x]", "expected names such as"),
        ("allowed_hosts", "[1:2]", "expected names such as"),
        ("allowed_hosts", "*.example.org", "expected names such as"),
        ("allowed_hosts", "localhost,Building.example:8080", "write building.example instead"),
        ("allowed_hosts", "[::1]:8080", r"write \[::1\] instead"),
        ("allowed_hosts", "localhost:", "write localhost instead"),
        ("allowed_hosts", "0.0.0.0", "every address of a machine"),
        ("allowed_hosts", "::", "every address of a machine"),
    ],
)
def test_a_mistake_names_the_setting_that_has_it(setting, value, words):
    with pytest.raises(ValidationError, match=words) as caught:
        GatewaySettings(**{setting: value})
    assert [fault["loc"] for fault in caught.value.errors()] == [(setting,)]


@pytest.mark.parametrize(
    ("origins", "foreign_one"),
    [
        ([], None),
        (["http://localhost:8080"], None),
        (["https://[::1]"], None),
        (["http://evil.example"], "http://evil.example"),
        (["null"], "null"),
        ([""], ""),
        (["localhost"], "localhost"),
        (["http://localhost@evil.example"], "http://localhost@evil.example"),
        (["http://localhost", "http://evil.example"], "http://evil.example"),
    ],
)
def test_pages_of_other_sites(origins, foreign_one):
    assert foreign_origin(origins, names()) == foreign_one
    assert foreign_origin(origins, None) is None


# --- proxies ------------------------------------------------------------------------------------------------------

TRUSTED = networks("10.0.0.0/24, ::1, 192.168.7.7")


@pytest.mark.parametrize(
    ("peer", "forwarded", "asks"),
    [
        ("203.0.113.5", [], "203.0.113.5"),
        ("203.0.113.5", ["1.2.3.4"], "203.0.113.5"),  # nobody's proxy: what it says is its own affair
        ("10.0.0.1", [], "10.0.0.1"),
        ("10.0.0.1", ["203.0.113.5"], "203.0.113.5"),
        ("10.0.0.1", ["1.2.3.4, 203.0.113.5"], "203.0.113.5"),  # the first was made up by who asked
        ("10.0.0.1", ["1.2.3.4", "203.0.113.5, 10.0.0.9"], "203.0.113.5"),
        ("10.0.0.1", ["10.0.0.2, 10.0.0.3"], "10.0.0.2"),
        ("10.0.0.1", ["203.0.113.5, nonsense"], "10.0.0.1"),
        ("10.0.0.1", ["203.0.113.5, "], "10.0.0.1"),
        ("10.0.0.1", ["203.0.113.5:4711"], "203.0.113.5"),
        ("10.0.0.1", ["[2001:db8::7]:4711"], "2001:db8::7"),
        ("::ffff:10.0.0.1", ["2001:db8::7"], "2001:db8::7"),
        ("::1", ["fe80::1%eth0"], "fe80::1"),
        ("", ["1.2.3.4"], ""),
    ],
)
def test_who_asks(peer, forwarded, asks):
    assert client_address(peer, forwarded, TRUSTED) == asks


@given(st.lists(st.text(max_size=60), max_size=5))
def test_without_trusted_proxies_nothing_is_believed(forwarded):
    assert client_address("203.0.113.5", forwarded, ()) == "203.0.113.5"


@given(st.lists(st.text(max_size=60), max_size=5))
def test_whatever_is_forwarded_an_address_comes_out(forwarded):
    """No line of the log can be made to hold anything else."""
    assert networks(client_address("10.0.0.1", forwarded, TRUSTED))


def test_the_setting_of_proxies_says_what_it_expects():
    assert GatewaySettings().proxies == ()
    assert len(GatewaySettings(trusted_proxies="10.0.0.1, [::1],10.1.0.0/16").proxies) == 3
    with pytest.raises(ValueError, match=r"such as 10\.0\.0\.7 or 10\.0\.0\.0/24"):
        GatewaySettings(trusted_proxies="proxy.example")
