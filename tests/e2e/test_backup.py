"""A running system is saved in mid-mission, its stores are destroyed and restored: maps and missions are as they were saved."""

from __future__ import annotations

import shutil
import time
from pathlib import Path

import pytest

from surveilnav.bus import clock_ns
from surveilnav.cli.backup import backup, restore
from surveilnav.contract import MAP_SNAPSHOT, MISSION_PAUSE
from surveilnav.errors import ConfigError
from surveilnav.messages import FINISHED_STATES, MissionPause
from tests.waiting import until


def maps_of(s) -> tuple[int, str]:
    """How many views the maps hold, and what they come to."""
    held = s.node.ask(MAP_SNAPSHOT, parameters={"only": "digest"}).message
    return held.revision, held.digest


def settled_maps_of(s) -> tuple[int, str]:
    """The maps, once the views that were under way are in them: for two seconds they don't change."""
    held, since_s = maps_of(s), time.monotonic()

    def settled() -> bool:
        nonlocal held, since_s
        if (now := maps_of(s)) != held:
            held, since_s = now, time.monotonic()
        return time.monotonic() > since_s + 2.0

    until(settled, timeout_s=60)
    return held


def pause(s, mission: str, *, paused: bool) -> None:
    s.node.ask(MISSION_PAUSE, MissionPause(stamp_ns=clock_ns(), mission=mission, paused=paused), mission=mission)


def stop_all(s) -> None:
    """Stops everything but the router, to which the test is connected."""
    services = [process for name, process in s.stack.processes.items() if name != "router"]
    for process in services:
        process.terminate()
    for process in services:
        process.wait(30)
    until(lambda: not s.node.alive("fusion") and not s.node.alive("planner"), timeout_s=30)


@pytest.mark.slow
def test_stores_that_were_saved_in_mid_mission_come_back(system, tmp_path):
    s, mission = system(cameras=1), "m1"
    state, looks = Path(s.stack.environment["SURVEILNAV_FUSION__STORE"]).parent, tmp_path / "looks"
    moving, standing = tmp_path / "moving.backup", tmp_path / "standing.backup"
    s.search("tv", mission=mission)
    s.wait(lambda m: m.step >= 4, 90, mission)
    backup(moving, state=state, looks=looks)  # while the robot moves, and fusion and planner write
    step = s.status(mission).step
    s.wait(lambda m: m.step > step, 60, mission)
    pause(s, mission, paused=True)
    s.wait(lambda m: m.state == "paused", 30, mission)
    saved = s.status(mission)

    def saved_while_nothing_came() -> tuple[int, str] | None:
        held = settled_maps_of(s)
        backup(standing, state=state, looks=looks, force=True)
        return held if maps_of(s) == held else None  # else a view of the camera was still on its way

    held = until(saved_while_nothing_came, timeout_s=120)
    with pytest.raises(ConfigError, match="a service is using"):
        restore(standing, state=state, looks=looks, force=True)
    pause(s, mission, paused=False)
    s.wait(lambda m: m.step >= saved.step + 2, 60, mission)

    stop_all(s)
    shutil.rmtree(state)
    restore(standing, state=state, looks=looks)
    s.stack.start("fusion")
    until(lambda: s.node.alive("fusion"), timeout_s=60)
    assert maps_of(s) == held, "maps are the same to the bit"
    for name in s.stack.processes:
        if name not in ("router", "fusion"):
            s.stack.start(name)
    s.stack.wait_ready(s.node, 90)
    back = s.status(mission)
    assert (back.state, back.step, back.path_m) == ("paused", saved.step, saved.path_m)

    stop_all(s)
    restore(moving, state=state, looks=looks, force=True)
    for name in s.stack.processes:
        if name != "router":
            s.stack.start(name)
    s.stack.wait_ready(s.node, 90)
    ended = s.wait(lambda m: m.state in FINISHED_STATES, 180, mission)
    assert (ended.state, ended.found) == ("done", True), ended
