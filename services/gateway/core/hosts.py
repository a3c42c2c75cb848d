"""Who is answered and who asks: the names in ``Host`` and ``Origin`` headers, and the address behind trusted proxies.

A page of a stranger can have its own name resolve to this machine (DNS rebinding). The browser then takes the gateway
for that page's own site, and shows the page what the gateway answers. But the ``Host`` header still has the stranger's name,
so that is checked. Such a page can also have the browser send a request without reading the answer; then its name is in the
``Origin`` header.

Why this isn't Starlette's TrustedHostMiddleware and uvicorn's ProxyHeadersMiddleware: docs/understand/adr/0011.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from ipaddress import (
    AddressValueError,
    IPv4Address,
    IPv4Network,
    IPv6Address,
    IPv6Network,
    ip_address,
    ip_network,
)

Networks = tuple[IPv4Network | IPv6Network, ...]
_NAME = r"[a-z0-9_.-]+?"
#: A host as it stands in a URL: a name, an IPv4 address, or an IPv6 address in brackets; then maybe a port.
_HOST = re.compile(rf"(?P<name>\[(?P<ipv6>[0-9a-f:.]+)\]|{_NAME})\.?(?P<port>:\d{{0,5}})?", re.IGNORECASE)
#: Addresses that mean every address of a machine. Nobody can reach it by them.
_ANY_ADDRESS = frozenset({"", "0.0.0.0", "::"})


# --- settings -----------------------------------------------------------------------------------------------------


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


def is_loopback(listens_at: str) -> bool:
    """Whether a server at an address (of ``listen_address``) is reached from its own machine alone."""
    address = _address(listens_at)
    return address.is_loopback if address else listens_at.lower().removesuffix(".") == "localhost"


def allowed_names(listed: str) -> frozenset[str] | None:
    """The names in a comma-separated list; None for ``*``, which allows any name.

    Raises:
        ValueError: an entry is no host, has a port, or means every address of a machine.
    """
    entries = [entry.strip() for entry in listed.split(",") if entry.strip()]
    return None if "*" in entries else frozenset(map(_name_of, entries))


def names_of_address(listens_at: str) -> frozenset[str]:
    """The name by which a server at an address (of ``listen_address``) is reached; none where that is every address."""
    if listens_at in _ANY_ADDRESS:
        return frozenset()
    bare = listens_at.partition("%")[0]  # clients leave out the interface
    return frozenset({f"[{bare}]" if ":" in bare else bare.lower().removesuffix(".")})


def networks(listed: str) -> Networks:
    """The addresses and networks in a comma-separated list.

    Raises:
        ValueError: an entry is neither.
    """
    entries = [entry.strip().strip("[]") for entry in listed.split(",") if entry.strip()]
    try:
        return tuple(ip_network(entry, strict=False) for entry in entries)
    except ValueError as error:
        raise ValueError(
            f"expected addresses or networks such as 10.0.0.7 or 10.0.0.0/24 with commas between: {error}"
        ) from error


# --- requests -----------------------------------------------------------------------------------------------------


def host_name(header: str) -> str | None:
    """The name in a ``Host`` header, in lower case, without port and final dot; None if it is no host."""
    match = _HOST.fullmatch(header)
    return _normalized(match) if match else None


def foreign_host(headers: Iterable[str], allowed: frozenset[str] | None) -> str | None:
    """The first ``Host`` header of a request that isn't allowed, "" if it has none; None if the request may be answered."""
    if allowed is None:
        return None
    hosts = list(headers)
    return next((host for host in hosts if host_name(host) not in allowed), None if hosts else "")


def foreign_origin(origins: Iterable[str], allowed: frozenset[str] | None) -> str | None:
    """The first ``Origin`` header of a request that names another site; None if there is none, or no page sent it."""
    if allowed is None:
        return None
    return next((o for o in origins if host_name(o.partition("://")[2]) not in allowed), None)


def client_address(peer: str, forwarded: Sequence[str], trusted: Networks) -> str:
    """The address of the client: the peer's, or the one that trusted proxies name.

    Every proxy appends the address of its own peer to ``X-Forwarded-For``. So the list is read from its end, for as long as
    the entry was written by a trusted proxy. The first address that isn't a trusted proxy is the client's; anybody could
    have made up what stands before it.

    Args:
        peer: the other end of the connection; "" where there is none, as in tests.
        forwarded: the values of all ``X-Forwarded-For`` headers, in their order.
    """
    client = peer
    for entry in reversed([e.strip() for value in forwarded for e in value.split(",")]):
        if not _is_in(client, trusted) or (address := _address(entry)) is None:
            break
        client = str(address)
    return client


def _is_in(text: str, trusted: Networks) -> bool:
    address = _address(text)
    return address is not None and any(address in network for network in trusted)


def _address(text: str) -> IPv4Address | IPv6Address | None:
    """The address in a text, without its port; an IPv4 address within an IPv6 one as IPv4. None if there is none."""
    bare = text.strip().removeprefix("[").partition("]")[0] if text.strip().startswith("[") else text.strip()
    if bare.count(":") == 1:
        bare = bare.partition(":")[0]
    try:
        address = ip_address(bare.partition("%")[0])
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address


def _name_of(entry: str) -> str:
    match = _HOST.fullmatch(f"[{entry}]" if _ipv6(entry) else entry)
    name = _normalized(match) if match else None
    if match is None or name is None:
        raise ValueError(f"expected names such as building.example or [::1] with commas between, got {entry!r}")
    if match["port"] is not None:
        raise ValueError(f"expected names without a port (any is answered): write {name} instead of {entry}")
    if name.strip("[]") in _ANY_ADDRESS:
        raise ValueError(
            f"{entry} stands for every address of a machine: write the names that people use, or * for any"
        )
    return name


def _normalized(match: re.Match[str]) -> str | None:
    """A host's name in its one spelling; None for an invalid IPv6 address."""
    if match["ipv6"] is None:
        return match["name"].lower()
    address = _ipv6(match["ipv6"])
    return f"[{address}]" if address else None


def _ipv6(text: str) -> IPv6Address | None:
    try:
        return IPv6Address(text)
    except AddressValueError:
        return None
