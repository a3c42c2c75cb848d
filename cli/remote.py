"""A running system, through its gateway."""

from __future__ import annotations

import json
import time
from typing import Any
from urllib.parse import urlencode

import httpx
from rich.console import Console
from rich.markup import escape

from surveilnav.errors import GatewayError
from surveilnav.messages import FINISHED_STATES
from surveilnav.words import canonical

_LOST_S = 20.0


def call(url: str, method: str, path: str, body: dict[str, Any] | None = None) -> Any:
    """One REST call; every failure becomes a GatewayError that says what to do."""
    try:
        response = httpx.request(method, url.rstrip("/") + path, json=body, timeout=30.0)
    except (httpx.HTTPError, httpx.InvalidURL) as error:
        raise GatewayError(
            "no_gateway",
            f"no gateway answers at {url} ({error}). Start one with `surveilnav up` or `docker compose up`, or name its "
            "address with --url or SURVEILNAV_URL.",
        ) from error
    try:
        answer = response.json()
    except ValueError:
        raise GatewayError(
            "no_gateway", f"{url} isn't a SurveilNav gateway: {path} answered {response.status_code} without JSON"
        ) from None
    if response.is_error:
        raise _refusal(answer if isinstance(answer, dict) else {}, response)
    return answer


def _refusal(problem: dict[str, Any], response: httpx.Response) -> GatewayError:
    """What RFC 9457's members say; other servers' errors by their status."""
    name = str(problem.get("type", "")).rpartition(":")[2] or str(response.status_code)
    return GatewayError(name, str(problem.get("detail") or problem.get("title") or response.reason_phrase))


def follow_mission(url: str, target: str, robot: str, max_steps: int, console: Console) -> dict[str, Any]:
    """Submits a mission and shows its progress to the end; the mission's last state."""
    body: dict[str, Any] = {"target": target, "max_steps": max_steps} | ({"robot": robot} if robot else {})
    mission: dict[str, Any] = call(url, "POST", "/api/v1/missions", body)
    if canonical(target) != canonical(mission["target"]):
        console.print(f"{target}: perception calls it {mission['target']}", markup=False)
    try:
        mission = _followed(url, mission["id"], console)
    except KeyboardInterrupt:
        call(url, "POST", f"/api/v1/missions/{mission['id']}/cancel")
        console.print("cancelled: the robot stops")
        raise
    colour = "green" if mission.get("found") else "red"
    console.print(
        f"[{colour}]{mission['state']}[/] {escape(str(mission.get('error') or ''))} {escape(str(mission.get('message', '')))}"
    )
    return mission


def _followed(url: str, id: str, console: Console) -> dict[str, Any]:
    """The finished mission; until then a line for each change."""
    shown, heard_s = "", time.monotonic()
    while True:
        mission: dict[str, Any] = call(url, "GET", f"/api/v1/missions/{id}")
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


def list_objects(url: str, text: str, label: str, floor: str, console: Console, as_json: bool) -> None:
    """Prints the objects of the maps: the last seen first, or those first that look most like a text."""
    asked = {"text": text, "label": label, "floor": floor}
    query = urlencode({name: value for name, value in asked.items() if value} | {"limit": "1000"})
    items = call(url, "GET", f"/api/v1/objects?{query}")["items"]
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


def system_status(url: str, console: Console, as_json: bool) -> None:
    """Prints what the gateway knows."""
    paths = {name: f"/api/v1/{name}" for name in ("services", "robots", "cameras", "perception", "missions")}
    answer = {name: call(url, "GET", path) for name, path in paths.items()}
    if as_json:
        print(json.dumps(answer))
        return
    for name, rows in answer.items():
        items = rows.get("items", []) if isinstance(rows, dict) else rows
        console.print(f"[bold]{name}[/] ({len(items)})")
        for row in items:
            facts = {k: v for k, v in row.items() if isinstance(v, (str, int, float, bool)) and v != ""}
            console.print("  " + "  ".join(f"{k}={v}" for k, v in list(facts.items())[:8]), markup=False)
            for note in row.get("notes", []):
                console.print(f"  note: {note}", markup=False)
