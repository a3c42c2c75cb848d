"""Every service of ``surveilnav up`` is killed while the robot searches: it comes back, and the search goes on."""

from __future__ import annotations

import io
import re
from itertools import cycle

import pytest
from rich.console import Console

from surveilnav.cli.status import everything, show_status
from surveilnav.client import Client
from tests.e2e.kills import SERVICES, Up, up
from tests.waiting import until


def search_under_way(system: Up, missions: list[str], targets: cycle[str]) -> None:
    """Waits until the last of ``missions`` has made some steps; a new one is begun where it ended meanwhile."""
    while not missions or not system.goes_on(missions[-1], steps=4):
        missions.append(system.search(next(targets)))


@pytest.mark.slow
def test_searches_survive_the_death_of_any_service(tmp_path, home_cache, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
    missions: list[str] = []
    targets = cycle(("tv", "bed"))
    with up(tmp_path) as system:
        for name in SERVICES:
            search_under_way(system, missions, targets)
            system.kill(name)
            told = until(lambda: (s := system.services().get(name)) and s["restarts"] and s, f"nobody told of {name}")  # noqa: B023
            assert (told["running"], told["restarts"], told["why"]) == (True, 1, "SIGKILL")
            assert f"{name} ended (SIGKILL): it starts again in 0.5 s" in system.said
        ends = [system.end(id) for id in missions]
        assert all((end["state"], end["found"]) == ("done", True) for end in ends), ends
        (robot,) = system.gateway.get("/api/v1/robots").json()["items"]
        decided = sum(end["step"] for end in ends)
        assert robot["seq"] == decided, "no action twice, none lost, and the robot knows its place"
        show_status(everything(Client(str(system.gateway.base_url))), Console(file=(shown := io.StringIO()), width=500))
        assert re.search(r"router +runs +1 .*SIGKILL", shown.getvalue()), shown.getvalue()
        system.kill_itself()
