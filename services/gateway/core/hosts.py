"""Under which names the gateway answers.

A page of a stranger can have its own name resolve to this machine (DNS rebinding). The browser then takes the gateway
for that page's own site, and hands over what it answers. It says the stranger's name as ``Host``, so that is looked at.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

#: A host as it stands in a URL: a name, an IPv4 address, or an IPv6 address in brackets; then maybe a port.
_HOST = re.compile(r"(?P<name>\[[0-9a-f:.%]+\]|[a-z0-9_.-]+?)\.?(?::\d{0,5})?", re.IGNORECASE)
#: What binds every address of a machine is no name to reach it by.
_ANY_ADDRESS = frozenset({"", "0.0.0.0", "::"})


def host_name(header: str) -> str | None:
    """The name in a ``Host`` header, in small letters, without port and final dot; None: it is no host."""
    match = _HOST.fullmatch(header)
    return match["name"].lower() if match else None


def allowed_names(listed: str, listens_at: str) -> frozenset[str] | None:
    """The names that are answered: those of a list with commas, and the address listened at; None: all, for ``*``.

    Raises:
        ValueError: an entry that is no host.
    """
    entries = [entry.strip() for entry in listed.split(",") if entry.strip()]
    if "*" in entries:
        return None
    if listens_at not in _ANY_ADDRESS:
        entries.append(f"[{listens_at}]" if ":" in listens_at else listens_at)
    return frozenset(map(_name_of, entries))


def _name_of(entry: str) -> str:
    name = host_name(f"[{entry}]" if entry.count(":") > 1 and not entry.startswith("[") else entry)
    if name is None:
        raise ValueError(f"expected names such as building.example or [::1] with commas between, got {entry!r}")
    return name


def foreign(headers: Iterable[str], allowed: frozenset[str] | None) -> str | None:
    """What of a request's ``Host`` headers isn't allowed, empty if there is none; None: it may be answered."""
    if allowed is None:
        return None
    said = list(headers)
    return next((host for host in said if host_name(host) not in allowed), None if said else "")
