"""compose.bench.yaml on a real Docker engine: hardware in containers, beside services that know nothing of a simulator."""

from __future__ import annotations

import os
from collections.abc import Iterator

import pytest

from tests.compose.stack import UP_S, Stack, missing
from tests.waiting import until

pytestmark = [pytest.mark.compose, pytest.mark.slow, pytest.mark.timeout(UP_S + 600)]


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    if not os.environ.get("SURVEILNAV_TEST_BENCH_COMPOSE"):
        pytest.skip(
            "for releases: SURVEILNAV_TEST_BENCH_COMPOSE=1; tests/e2e/test_as_real_homes.py plays the same without Docker"
        )
    if why := missing():
        pytest.skip(f"no Docker engine with Compose v2 here ({why})")
    models = tmp_path_factory.mktemp("models")
    models.chmod(0o755)
    stack = Stack(models, "compose.bench.yaml", SURVEILNAV_SIM__BUILDING="parametric_flat", SURVEILNAV_SIM__CAMERAS="2")
    with stack.running("--scale", "camera=2"):
        yield stack


def test_a_search_on_hardware_is_found_and_services_hold_no_simulator(bench: Stack) -> None:
    until(lambda: any(r["seq"] for r in bench.get("/api/v1/robots")["items"]), bench.state, 90.0)
    ended = bench.search("tv")
    assert (ended["state"], ended["found"]) == ("done", True), f"{ended}\n{bench.state()}"
    cameras = bench.get("/api/v1/cameras")["items"]
    assert sorted(c["id"] for c in cameras) == ["c0-1", "c0-2"]
    assert {c["stream"]["state"] for c in cameras} == {"live"}
    simulated = {c["Service"] for c in bench.containers() if c["Image"] == "surveilnav-simulation"}
    assert simulated == {"describe", "hardware-cameras", "hardware-robot"}
