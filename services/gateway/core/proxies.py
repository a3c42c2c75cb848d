"""Who asks, where proxies stand between."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from ipaddress import IPv4Address, IPv4Network, IPv6Address, IPv6Network, ip_address, ip_network

Networks = tuple[IPv4Network | IPv6Network, ...]


def networks(listed: str) -> Networks:
    """The addresses and networks of a list with commas.

    Raises:
        ValueError: an entry that is neither.
    """
    entries = [entry.strip().strip("[]") for entry in listed.split(",") if entry.strip()]
    try:
        return tuple(ip_network(entry, strict=False) for entry in entries)
    except ValueError as error:
        raise ValueError(
            f"expected addresses or networks such as 10.0.0.7 or 10.0.0.0/24 with commas between: {error}"
        ) from error


def client_address(peer: str, forwarded: Sequence[str], trusted: Networks) -> str:
    """The address of who asks: the peer's, or what trusted proxies say of whom they ask for.

    Every proxy adds its own peer at the end of ``X-Forwarded-For``, so the list is read from there, as long as a trusted one
    wrote. The first that isn't a trusted proxy is who asks: what stands before it anybody can have made up.

    Args:
        peer: the other end of the connection; "" where there is none, as in tests.
        forwarded: the values of all ``X-Forwarded-For`` headers, in their order.
        trusted: the proxies.
    """
    asks = peer
    for entry in reversed([e.strip() for value in forwarded for e in value.split(",")]):
        if not _is_in(asks, trusted) or (address := _address(entry)) is None:
            break
        asks = str(address)
    return asks


def _is_in(text: str, trusted: Iterable[IPv4Network | IPv6Network]) -> bool:
    address = _address(text)
    return address is not None and any(address in network for network in trusted)


def _address(text: str) -> IPv4Address | IPv6Address | None:
    """The address, an IPv4 address within an IPv6 one as itself; None: it is none. A port is left out."""
    bare = text.strip().removeprefix("[").partition("]")[0] if text.strip().startswith("[") else text.strip()
    if bare.count(":") == 1:
        bare = bare.partition(":")[0]
    try:
        address = ip_address(bare.partition("%")[0])
    except ValueError:
        return None
    return getattr(address, "ipv4_mapped", None) or address
