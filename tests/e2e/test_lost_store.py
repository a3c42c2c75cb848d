"""One of two stores is lost in mid-mission: the system comes up, says so, and missions go on or end by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from surveilnav.contract import MISSION_STATUS
from surveilnav.messages import FINISHED_STATES
from tests.waiting import until


def lose(s, service: str) -> None:
    """Kills a service, removes its store, and starts it again."""
    path = Path(s.stack.environment[f"SURVEILNAV_{service.upper()}__STORE"])
    s.kill(service)
    assert path.exists()
    for part in path.parent.glob(f"{path.name}*"):
        part.unlink()
    s.stack.start(service)


@pytest.mark.slow
def test_without_its_maps_a_mission_goes_on_with_new_ones(running):
    s, mission = running, "maps-lost"
    s.search("tv", mission=mission)
    s.wait(lambda m: m.step >= 4, 90, mission)
    lose(s, "fusion")
    until(lambda: "they begin empty" in s.stack.log_of("fusion").read_text(), timeout_s=60)
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 240, mission)
    assert (ended.state, ended.found) == ("done", True), ended


@pytest.mark.slow
def test_without_its_missions_the_planner_ends_them_by_name_and_takes_new_ones(running):
    s, mission = running, "missions-lost"
    s.search("bed", mission=mission)
    s.wait(lambda m: m.step >= 4, 90, mission)
    lose(s, "planner")
    told = until(
        lambda: [a.message for a in s.node.ask_all(MISSION_STATUS) if a.message.mission == mission], timeout_s=60
    )
    assert (told[0].state, told[0].error) == ("failed", "mission_lost")
    s.search("tv", mission="after")
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 180, "after")
    assert (ended.state, ended.found) == ("done", True), ended


@pytest.mark.slow
def test_without_its_place_the_robot_begins_at_its_start_and_its_mission_goes_on(running):
    s, mission = running, "place-lost"
    s.search("bed", mission=mission)
    s.wait(lambda m: m.step >= 4, 90, mission)
    lose(s, "robot")
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 240, mission)
    assert (ended.state, ended.found) == ("done", True), ended
