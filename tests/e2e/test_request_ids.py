"""One mission over REST: its request's id is in the log of every service that worked on it, also after the planner was killed."""

from __future__ import annotations

import httpx
import pytest

from surveilnav.messages import FINISHED_STATES
from tests.waiting import until


@pytest.mark.slow
def test_the_id_of_a_missions_request_is_in_every_services_log(running):
    s, id = running, "order-7"
    with httpx.Client(base_url=f"http://127.0.0.1:{s.gateway_port}", timeout=20) as gateway:

        def submitted():
            answer = gateway.post("/api/v1/missions", json={"target": "tv"}, headers={"X-Request-ID": id})
            return answer.status_code == 202 and answer.json()

        mission = until(submitted, timeout_s=30)["id"]
        until(lambda: s.status(mission).step >= 3, timeout_s=60)
        s.kill("planner")
        s.stack.start("planner")
        until(lambda: gateway.get(f"/api/v1/missions/{mission}").json()["state"] in FINISHED_STATES, timeout_s=180)
        assert gateway.get(f"/api/v1/missions/{mission}").json()["request_id"] == id
        page = gateway.get("/api/v1/missions", headers={"X-Request-ID": "another"})
    assert page.headers["x-request-id"] == "another"

    def lines_of(service: str) -> list[str]:
        return [line for line in s.stack.log_of(service).read_text().splitlines() if id in line]

    expected = {
        "gateway": "commanded",
        "planner": "resumes a mission",
        "robot": "begins a mission",
        "fusion": "takes in a mission's views",
        "perception": "looks at views for a request",
    }
    for service, event in expected.items():
        until(lambda: any(event in line for line in lines_of(service)), f"{service}: {lines_of(service)}")  # noqa: B023
    assert any("mission ended" in line for line in lines_of("planner"))
