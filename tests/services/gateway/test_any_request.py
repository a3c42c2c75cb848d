"""Whatever is asked of any address: no 5xx of our own making, and every answer is as the OpenAPI document says.

schemathesis makes requests from the document itself, right ones and wrong ones: a new address is tested as soon as it is
there. The same is asked of a gateway with keys, by nobody and with the key of each role. SURVEILNAV_TEST_REQUESTS=500 makes so
many requests of each address, instead of a few.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any
from unittest.mock import MagicMock

import httpx
import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, settings
from schemathesis.checks import (
    content_type_conformance,
    not_a_server_error,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from surveilnav.bus import clock_ns
from surveilnav.messages import MissionStatus
from surveilnav.security.api_keys import ApiKeysFile
from surveilnav.security.roles import Role
from surveilnav.services.gateway.app import create_app
from surveilnav.services.gateway.authentication import Authentication
from surveilnav.services.gateway.core.attempts import FailedAttempts

CHECKS = [
    content_type_conformance,
    not_a_server_error,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
]
#: What is there, by the noun of a path and the name of its parameter.
THERE = {
    ("cameras", "id"): "c1",
    ("missions", "id"): "m-there",
    ("floors", "id"): "0",
    ("cameras", "view"): "3",
    ("floors", "layer"): "value",
    ("floors", "object"): "1",
}
#: Problems that the fakes have: a picture that is none, no recorder, nobody who forgets pictures.
OF_FAKES = ("bad_picture", "absent", "keeper_silent")
#: They never end: tests of their own read them.
STREAMS = ["/api/v1/events", "/api/v1/live", "/api/v1/tiles"]
api = schemathesis.openapi.from_dict(create_app(MagicMock(), None).openapi())


@api.hook
def map_path_parameters(context: Any, path_parameters: dict[str, Any] | None) -> dict[str, Any] | None:
    """Half of what is drawn is replaced by what is there."""
    noun = context.operation.path.removeprefix("/api/v1/").partition("/")[0]
    return path_parameters and {
        name: THERE.get((noun, name), value) if len(str(value)) % 2 else value
        for name, value in path_parameters.items()
    }


def requests_of_each(default: int) -> Any:
    return settings(
        max_examples=int(os.environ.get("SURVEILNAV_TEST_REQUESTS", default)),
        deadline=None,
        derandomize=True,
        database=None,
        phases=[Phase.explicit, Phase.generate],
        suppress_health_check=list(HealthCheck),
    )


MANY, FEW = requests_of_each(20), requests_of_each(2)


@dataclass(frozen=True)
class Guarded:
    """A gateway that answers only with a key, and the key of each role."""

    url: str
    keys: dict[str, str]
    authentication: Authentication


@pytest.fixture(scope="module")
def guarded(
    tmp_path_factory: pytest.TempPathFactory, router: str, building: Any, client: Any, start_gateway: Any
) -> Iterator[Guarded]:
    file = ApiKeysFile(tmp_path_factory.mktemp("keys") / "keys.json")
    keys = {role.name: file.add(role.name, role) for role in Role}
    authentication = Authentication(file.path)
    with ExitStack() as stack:
        url, _ = start_gateway(router, stack, authentication=authentication)
        yield Guarded(url, keys, authentication)


@pytest.fixture(scope="module")
def url(client: httpx.Client, building: Any) -> str:
    building.put_status(
        MissionStatus(
            stamp_ns=clock_ns(),
            mission="m-there",
            target="tv",
            robot="r1",
            state="active",
            phase="exploring",
            step=1,
            max_steps=9,
            path_m=1.0,
        )
    )
    return str(client.base_url)


@api.exclude(path=STREAMS).parametrize()
@MANY
def test_any_request_is_answered_as_documented(case: Any, url: str) -> None:
    _check(case, case.call(base_url=url))


@pytest.mark.parametrize("role", [None, *(role.name for role in Role)])
@api.exclude(path=STREAMS).parametrize()
@FEW
def test_any_request_with_any_key_is_answered_as_documented(case: Any, role: str | None, guarded: Guarded) -> None:
    guarded.authentication._failed = FailedAttempts()  # all requests come from one address
    headers = {"Authorization": f"Bearer {guarded.keys[role]}"} if role else {}
    answer = case.call(base_url=guarded.url, headers=headers)
    _check(case, answer)
    signs_in = case.operation.path.endswith("/session")  # with the key in its body
    assert role is None or signs_in or answer.status_code != 401, "a key that is right"
    assert not any(key.encode() in answer.content for key in guarded.keys.values()), "an answer with a key"


def _check(case: Any, answer: Any) -> None:
    assert b"Traceback" not in answer.content
    if answer.status_code >= 500 and answer.json()["type"].rpartition(":")[2] in OF_FAKES:
        return
    case.validate_response(answer, checks=CHECKS)
