"""Who asks, where proxies stand between: only those that are trusted are believed."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.gateway.config import GatewaySettings
from surveilnav.services.gateway.core.proxies import client_address, networks

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


def test_the_setting_says_what_it_expects():
    assert GatewaySettings().proxies == ()
    assert len(GatewaySettings(trusted_proxies="10.0.0.1, [::1],10.1.0.0/16").proxies) == 3
    with pytest.raises(ValueError, match=r"such as 10\.0\.0\.7 or 10\.0\.0\.0/24"):
        GatewaySettings(trusted_proxies="proxy.example")
