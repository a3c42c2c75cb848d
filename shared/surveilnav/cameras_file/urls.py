"""Addresses of streams. They hold passwords, so nothing but the decoder may get one as it is."""

from __future__ import annotations

import re
from collections.abc import Mapping
from urllib.parse import urlsplit

_VARIABLE = re.compile(r"\$\{([A-Za-z_][A-Za-z0-9_]*)\}")


def with_secrets(address: str, environment: Mapping[str, str]) -> str:
    """The address with ``${NAME}`` replaced by variables of the environment.

    Raises:
        ValueError: a variable isn't set. The message has its name and no other part of the address.
    """
    missing = sorted({name for name in _VARIABLE.findall(address) if not environment.get(name)})
    if missing:
        raise ValueError(f"the environment variable {missing[0]} isn't set, or is empty")
    return _VARIABLE.sub(lambda match: environment[match.group(1)], address)


def shown(address: str) -> str:
    """An address as people and logs may see it: without user, password and query, which often hold a password, too."""
    if "://" not in address:
        return address
    try:
        parts = urlsplit(address)
        host, port = parts.hostname or "", parts.port
    except ValueError:
        return f"{address.split('://', 1)[0]}://..."
    host = f"[{host}]" if ":" in host else host
    query = "?..." if parts.query else ""
    return f"{parts.scheme}://{host}{f':{port}' if port else ''}{parts.path}{query}"
