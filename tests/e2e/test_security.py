"""A whole search with security on: certificates, access rules and API keys, from the gateway to the recording."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest

from surveilnav.bus.router import free_port
from tests.e2e.conftest import System, starting
from tests.waiting import until

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def secured(tmp_path_factory: pytest.TempPathFactory, home_cache) -> Iterator[System]:
    with starting(tmp_path_factory.mktemp("secured"), home_cache) as start:
        yield start(cameras=2, gateway_port=free_port(), recorder=True, secure=True)


def test_a_search_works_as_without_security(secured):
    with httpx.Client(base_url=f"http://127.0.0.1:{secured.gateway_port}", timeout=30) as http:
        until(lambda: http.get("/readyz").status_code == 200, timeout_s=60)
        answers: list[httpx.Response] = []

        def submitted() -> bool:
            answers.append(http.post("/api/v1/missions", json={"target": "tv"}))
            return answers[-1].status_code == 202

        until(submitted, lambda: answers[-1].text, timeout_s=30)
        mission = answers[-1].json()["id"]
        ended = until(
            lambda: _ended(http, mission), lambda: http.get(f"/api/v1/missions/{mission}").json(), timeout_s=200
        )
        assert (ended["state"], ended["found"]) == ("done", True), ended
        cameras = http.get("/api/v1/cameras").json()["items"]
        assert len(cameras) == 2
        picture = http.get(f"/api/v1/cameras/{cameras[0]['id']}/views/0.jpg")
        assert picture.headers["content-type"] == "image/jpeg"
        assert http.get(f"/api/v1/missions/{mission}/plan").status_code == 200
        assert http.get("/api/v1/objects").json()["total"]
        kept = until(lambda: _complete(http), lambda: http.get("/api/v1/recordings").json(), timeout_s=40)
        assert kept["mission"] == mission
        invoked = http.get(f"/api/v1/missions/{mission}/traffic").json()
        assert invoked


def _ended(http: httpx.Client, mission: str) -> dict[str, object] | None:
    status = http.get(f"/api/v1/missions/{mission}").json()
    return status if status["state"] in ("done", "failed", "cancelled") else None


def _complete(http: httpx.Client) -> dict[str, object] | None:
    return next((r for r in http.get("/api/v1/recordings").json()["items"] if r["state"] == "complete"), None)
