"""Everything that people read fits a terminal of 80 columns, whole: no cut, no word broken, long ids and all."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import pytest
import typer
from rich.console import Console
from typer.testing import CliRunner

from surveilnav import rest
from surveilnav.cli import status
from surveilnav.cli.cameras import show_cameras
from surveilnav.cli.main import app
from surveilnav.cli.mission_words import show_mission, show_missions, show_plan
from surveilnav.cli.objects import show_objects
from surveilnav.cli.survey import show_buildings
from surveilnav.cli.traffic import show_traffic
from surveilnav.rest import examples

WIDTH = 80
LONG = "north-wing_" + "0123456789" * 5 + "abc"
WORDY = (
    "holding still: no answer from surveilnav/1/parametric_flat/map/0/occupancy, which is odd, and told of at length"
)


def paths(command: Any, names: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Every command and group, as it is typed."""
    yield names
    for name, sub in getattr(command, "commands", {}).items():
        yield from paths(sub, (*names, name))


COMMANDS = list(paths(typer.main.get_command(app)))


@pytest.mark.parametrize("names", COMMANDS, ids=" ".join)
def test_help_fits(names, monkeypatch):
    monkeypatch.setenv("TERMINAL_WIDTH", str(WIDTH))
    told = CliRunner().invoke(app, [*names, "--help"], env={"COLUMNS": str(WIDTH)}, prog_name="surveilnav")
    assert told.exit_code == 0
    assert_fits(told.stdout)
    command: Any = typer.main.get_command(app)
    for name in names:
        command = command.commands[name]
    options = [o for p in command.params for o in p.opts if o.startswith("--") and not o.endswith("-completion")]
    assert [option for option in options if option not in told.stdout] == [], "an option's name is broken"
    choices = re.findall(r"<[a-z]+(?:\|[a-z]+)+>", told.stdout)
    assert "|" not in re.sub("|".join(map(re.escape, choices)) or "$^", "", told.stdout), "a choice is broken"


def test_completion_is_named_once_and_clutters_no_table():
    told = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "80"}).stdout
    assert told.count("--install-completion") == 1
    assert "--show-completion" not in told


def assert_fits(text: str) -> None:
    assert [line for line in text.splitlines() if len(line) > WIDTH] == []
    assert "…" not in text


def shown(show: Any, *arguments: Any, **options: Any) -> str:
    """What a terminal of 80 columns has, without colours."""
    console = Console(
        file=io.StringIO(), width=WIDTH, force_terminal=True, no_color=True, color_system=None, highlight=False
    )
    show(*arguments, console, **options)
    return console.file.getvalue()  # type: ignore[attr-defined,no-any-return]


MISSION = rest.Mission.model_validate(
    examples.MISSION
    | {
        "id": LONG,
        "robot": "r-" + LONG[:60],
        "target": "something red to sit on",
        "message": WORDY,
        "error": "perception_down",
        "state": "confirming",
        "step": 4321,
        "max_steps": 5000,
        "path_m": 1234.5,
    }
)
CAMERA = rest.Camera.model_validate(
    examples.CAMERA
    | {
        "id": LONG,
        "floor": "basement-2",
        "labels": {"dining table": 0.81, "potted plant": 0.44, "tv": 0.2},
    }
)
ROBOT = rest.Robot.model_validate(
    examples.ROBOT | {"id": LONG, "mission": LONG, "message": WORDY, "notes": [WORDY], "state": "recovering"}
)
OBJECT = rest.Object.model_validate(
    examples.OBJECT
    | {
        "label": "fire extinguisher",
        "floor": "basement-2",
        "center_m": [-112.5, 1234.5, -10.0],
        "relevance": 0.61,
        "sources": [f"camera/{LONG}", "robot/r1"],
    }
)
_SOURCE = rest.SourceTraffic(
    id=LONG,
    node=f"camera/{LONG}",
    stale=False,
    offered_bytes=812_345_678_901,
    frames=3,
    delivered_bytes=812_345_678_901,
    wire_sent_bytes=None,
    frame_bytes=812_345_678_901,
    viewer_bytes=1,
    by_stream={},
)
_NODE = rest.NodeTraffic(
    id=LONG,
    kind="perception",
    stale=False,
    offered_bytes=1,
    delivered_bytes=812_345_678_901,
    offered_messages=1,
    delivered_messages=1,
    wire_sent_bytes=1,
    wire_received_bytes=None,
    simulation_bytes=0,
    rejected={"bad": 3},
)
TRAFFIC = rest.Traffic(
    offered_bytes=1,
    delivered_bytes=2,
    wire_sent_bytes=3,
    cameras=[_SOURCE],
    robots=[_SOURCE],
    nodes=[_NODE],
)
SERVICE = rest.Service(
    id=f"camera-{LONG}",
    stale=False,
    running=False,
    restarts=123,
    restarted=datetime(2026, 1, 31, 10, 0, 41, tzinfo=UTC),
    why=WORDY,
    given_up=True,
)
WORKER = rest.Worker(
    id=LONG,
    backend="yolo-world",
    stale=False,
    ready=False,
    queued=16,
    capacity=16,
    latency_ms=None,
    cached=0,
    models={},
    stages={},
    calibrated=False,
    why=WORDY,
)
EVERYTHING = {
    "services": [SERVICE],
    "robots": [ROBOT],
    "cameras": [CAMERA],
    "perception": [WORKER],
    "missions": [MISSION],
}
BUILDING = {
    "name": "2_bedroom_bow_window",
    "floors": ["B1", "0", "1"],
    "rooms": 123,
    "area_m2": 12345.6,
    "about": WORDY,
}
PLAN = rest.MissionPlan.model_validate(
    examples.PLAN | {"why": WORDY, "candidates": [{**c, "note": WORDY} for c in examples.PLAN["candidates"]]}
)


@pytest.mark.parametrize(
    ("show", "arguments", "whole"),
    [
        (show_missions, ([MISSION],), ["confirming", "4321/5000", "1234.5 m", "/parametric_flat/"]),
        (show_mission, (MISSION, PLAN), ["something red to sit on", "4321/5000"]),
        (show_plan, (PLAN,), ["6.0, 1.2", "0.02"]),
        (show_cameras, ([CAMERA],), ["invoked", "2.0, 1.0", "basement-2"]),
        (show_objects, ([OBJECT],), ["extinguisher", "-112.5, 1234.5, -10.0", "confirmed", "0.61"]),
        (show_traffic, (TRAFFIC,), ["812 GB", "all processes"]),
        (status.show_status, (EVERYTHING,), ["given up", "recovering", "not ready", "16/16"]),
        (show_buildings, ([BUILDING],), ["2_bedroom_bow_window", "12346"]),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_tables_fit(show, arguments, whole):
    text = shown(show, *arguments)
    assert_fits(text)
    assert [part for part in whole if part not in text] == []
    if LONG in str(arguments):
        assert is_whole(LONG, text)


def is_whole(id: str, text: str) -> bool:
    """Whether some column of the text holds an id, on one line or folded over several."""
    lines = text.splitlines()
    spans = ((left, right) for left in range(WIDTH) for right in range(left + 8, WIDTH + 1))
    return any(id in "".join(line[left:right].strip() for line in lines) for left, right in spans)


def test_the_nodes_fit_too():
    assert_fits(shown(show_traffic, TRAFFIC, nodes=True))


def test_a_file_gets_a_line_for_each_thing():
    console = Console(file=io.StringIO(), width=WIDTH)
    show_missions([MISSION, MISSION], console)
    lines = console.file.getvalue().splitlines()  # type: ignore[attr-defined]
    assert len(lines) == 3
    assert all(LONG in line and WORDY in line for line in lines[1:])


def test_strangers_texts_are_shown_and_not_obeyed():
    text = shown(show_missions, [MISSION.model_copy(update={"target": "[red]tv[/]", "message": "a\x1b[2Jb\u202ec"})])
    assert "[red]tv[/]" in text
    assert not set("\x1b\u202e") & set(text)
