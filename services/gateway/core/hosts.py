"""Under which names the gateway answers.

A page of a stranger can have its own name resolve to this machine (DNS rebinding). The browser then takes the gateway
for that page's own site, and hands over what it answers. It says the stranger's name as ``Host``, so that is looked at.
It can also have the browser send a request here without reading the answer. Then it is named as ``Origin``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from ipaddress import AddressValueError, IPv6Address

_NAME = r"[a-z0-9_.-]+?"
#: A host as it stands in a URL: a name, an IPv4 address, or an IPv6 address in brackets; then maybe a port.
_HOST = re.compile(rf"(?P<name>\[(?P<ipv6>[0-9a-f:.]+)\]|{_NAME})\.?(?P<port>:\d{{0,5}})?", re.IGNORECASE)
#: What binds every address of a machine is no name to reach it by.
_ANY_ADDRESS = frozenset({"", "0.0.0.0", "::"})


def host_name(header: str) -> str | None:
    """The name in a ``Host`` header, in small letters, without port and final dot; None: it is no host."""
    match = _HOST.fullmatch(header)
    return _spelled(match) if match else None


def listen_address(written: str) -> str:
    """The address or name to listen at, an IPv6 address without the brackets that it has in URLs.

    Raises:
        ValueError: it is neither, or has a port.
    """
    in_brackets = written.startswith("[") and written.endswith("]")
    bare = written[1:-1] if in_brackets else written
    address = _ipv6(bare)
    if address is None and (in_brackets or not re.fullmatch(rf"({_NAME})?", bare, re.IGNORECASE)):
        raise ValueError(
            "expected an address or a name of this machine without a port, such as 127.0.0.1, ::1 or 0.0.0.0"
        )
    return str(address) if address else bare


def allowed_names(listed: str) -> frozenset[str] | None:
    """The names that are answered, of a list with commas; None: all, for ``*``.

    Raises:
        ValueError: an entry that is no host, has a port, or is every address of a machine.
    """
    entries = [entry.strip() for entry in listed.split(",") if entry.strip()]
    return None if "*" in entries else frozenset(map(_name_of, entries))


def names_of_address(listens_at: str) -> frozenset[str]:
    """The name by which what listens at an address (of ``listen_address``) is reached; none where it is every address."""
    if listens_at in _ANY_ADDRESS:
        return frozenset()
    bare = listens_at.partition("%")[0]  # clients leave out through which interface
    return frozenset({f"[{bare}]" if ":" in bare else bare.lower().removesuffix(".")})


def foreign(headers: Iterable[str], allowed: frozenset[str] | None) -> str | None:
    """What of a request's ``Host`` headers isn't allowed, empty if there is none; None: it may be answered."""
    if allowed is None:
        return None
    said = list(headers)
    return next((host for host in said if host_name(host) not in allowed), None if said else "")


def foreign_origin(origins: Iterable[str], allowed: frozenset[str] | None) -> str | None:
    """Which of a request's ``Origin`` headers is a page of another site; None: none is, or no page sent it."""
    if allowed is None:
        return None
    return next((o for o in origins if host_name(o.partition("://")[2]) not in allowed), None)


def _name_of(entry: str) -> str:
    match = _HOST.fullmatch(f"[{entry}]" if _ipv6(entry) else entry)
    name = _spelled(match) if match else None
    if match is None or name is None:
        raise ValueError(f"expected names such as building.example or [::1] with commas between, got {entry!r}")
    if match["port"] is not None:
        raise ValueError(f"expected names without a port (any is answered): write {name} instead of {entry}")
    if name.strip("[]") in _ANY_ADDRESS:
        raise ValueError(
            f"{entry} stands for every address of a machine: write the names that people use, or * for any"
        )
    return name


def _spelled(match: re.Match[str]) -> str | None:
    """A host's name in one spelling; None: an IPv6 address that is none."""
    if match["ipv6"] is None:
        return match["name"].lower()
    address = _ipv6(match["ipv6"])
    return f"[{address}]" if address else None


def _ipv6(text: str) -> IPv6Address | None:
    try:
        return IPv6Address(text)
    except AddressValueError:
        return None
