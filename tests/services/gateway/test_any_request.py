"""Whatever is asked of any address: no 5xx of our own making, and every answer is as the OpenAPI document says.

schemathesis makes requests from the document itself, right ones and wrong ones: a new address is tested as soon as it is
there.
"""

from __future__ import annotations

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
from surveilnav.services.gateway.app import create_app

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


@api.exclude(
    path=["/api/v1/events", "/api/v1/live", "/api/v1/tiles"]
).parametrize()  # they never end: tests of their own read them
@settings(
    max_examples=20,
    deadline=None,
    derandomize=True,
    database=None,
    phases=[Phase.explicit, Phase.generate],
    suppress_health_check=list(HealthCheck),
)
def test_any_request_is_answered_as_documented(case: Any, url: str) -> None:
    answer = case.call(base_url=url)
    if answer.status_code >= 500 and answer.json()["type"].rpartition(":")[2] in OF_FAKES:
        return
    case.validate_response(answer, checks=CHECKS)
