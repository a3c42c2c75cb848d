"""A running system, through its gateway."""

from __future__ import annotations

import json
import time
from typing import Any

from rich.console import Console
from rich.markup import escape

from surveilnav.client import Client
from surveilnav.client.resources import Mission, RobotHalt
from surveilnav.errors import GatewayError
from surveilnav.messages import FINISHED_STATES
from surveilnav.words import canonical

_LOST_S = 20.0


def follow_mission(
    gateway: Client, target: str, robot: str, max_steps: int, console: Console, *, queue: bool = False
) -> Mission:
    """Submits a mission and shows its progress to the end; the mission's last state. ``queue``: it waits for a robot."""
    mission = gateway.submit(target, robot or None, max_steps, queue=queue)
    try:
        if canonical(target) != canonical(mission["target"]):
            console.print(f"{target}: perception calls it {mission['target']}", markup=False)
        mission = _followed(gateway, mission["id"], console)
    except KeyboardInterrupt:
        gateway.cancel(mission["id"])
        console.print("cancelled: the robot stops")
        raise
    colour = "green" if mission.get("found") else "red"
    console.print(
        f"[{colour}]{mission['state']}[/] {escape(str(mission.get('error') or ''))} {escape(str(mission.get('message', '')))}"
    )
    return mission


def _followed(gateway: Client, id: str, console: Console) -> Mission:
    """The finished mission; until then a line for each change."""
    shown, heard_s = "", time.monotonic()
    while True:
        mission = gateway.mission(id)
        line = f"{mission['phase']}  step {mission['step']}/{mission['max_steps']}  {mission.get('message', '')}"
        if line != shown:
            shown = line
            console.print(line, markup=False)
        if mission["state"] in FINISHED_STATES:
            return mission
        heard_s = heard_s if mission.get("stale") else time.monotonic()
        if time.monotonic() - heard_s > _LOST_S:
            raise GatewayError(
                "stale", "the planner hasn't been heard of for 20 s: see `surveilnav status` and its log"
            )
        time.sleep(0.5)


def list_objects(gateway: Client, text: str, label: str, floor: str, console: Console, as_json: bool) -> None:
    """Prints the objects of the maps: the last seen first, or those first that look most like a text."""
    items = gateway.objects(text, label=label, floor=floor)
    if as_json:
        print(json.dumps(items))
        return
    if not items:
        console.print("nothing is known of such objects yet")
    for o in items:
        fits = "" if o["relevance"] is None else f"  fits {o['relevance']:.2f}"
        at = ", ".join(f"{v:.1f}" for v in o["center_m"])
        console.print(
            f"{o['label']} {o['id']}  floor {o['floor']} at ({at}) m  {o['status']} {o['confidence']:.2f}{fits}",
            markup=False,
        )


def system_status(gateway: Client, console: Console, as_json: bool) -> None:
    """Prints what the gateway knows."""
    answer: dict[str, list[Any]] = {
        "services": list(gateway.services()), "robots": list(gateway.robots()), "cameras": list(gateway.cameras()),
        "perception": list(gateway.perception()), "missions": list(gateway.missions()),
    }  # fmt: skip
    if as_json:
        print(json.dumps({name: {"items": items, "total": len(items)} for name, items in answer.items()}))
        return
    for name, items in answer.items():
        console.print(f"[bold]{name}[/] ({len(items)})")
        for row in items:
            facts = {k: v for k, v in row.items() if isinstance(v, (str, int, float, bool)) and v != ""}
            console.print("  " + "  ".join(f"{k}={v}" for k, v in list(facts.items())[:8]), markup=False)
            for note in row.get("notes", []):
                console.print(f"  note: {note}", markup=False)


def stop_robots(gateway: Client, reason: str, console: Console, as_json: bool) -> None:
    """Stops all robots at once, or (GatewayError) says which of them didn't answer."""
    _tell_of_robots(gateway.stop_robots(reason), "stopped, until `surveilnav release`", console, as_json)


def release_robots(gateway: Client, console: Console, as_json: bool) -> None:
    """Releases all robots."""
    _tell_of_robots(gateway.release_robots(), "released; its mission is paused until it is resumed", console, as_json)


def _tell_of_robots(robots: list[RobotHalt], what: str, console: Console, as_json: bool) -> None:
    if as_json:
        print(json.dumps({"robots": robots}))
        return
    for robot in robots:
        console.print(f"{robot['robot']}  {'not there' if robot['stale'] else what}", markup=False)
