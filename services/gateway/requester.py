"""Who sends a request: the owner of its key, and its client's address."""

from __future__ import annotations

from dataclasses import dataclass

from starlette.requests import HTTPConnection
from starlette.types import Scope

from surveilnav.security.roles import Role
from surveilnav.services.gateway.core.hosts import Networks, client_address

_STATE = "person"


@dataclass(frozen=True, slots=True)
class Person:
    """The owner of a key, a person or a program: the key's name and role, and its id, which a new key doesn't have again."""

    name: str
    role: Role
    key_id: str


def address_of(connection: HTTPConnection, trusted_proxies: Networks) -> str:
    """The address of the client that sends a request. ``X-Forwarded-For`` of trusted proxies is believed."""
    peer = connection.client.host if connection.client else ""
    return client_address(peer, connection.headers.getlist("x-forwarded-for"), trusted_proxies)


def set_person(scope: Scope, person: Person | None) -> None:
    """Remembers who sends a request, for those who answer it."""
    scope.setdefault("state", {})[_STATE] = person


def person_of(connection: HTTPConnection) -> Person | None:
    """Who sends a request; None: nobody needs to say."""
    found = connection.scope.get("state", {}).get(_STATE)
    return found if isinstance(found, Person) else None
