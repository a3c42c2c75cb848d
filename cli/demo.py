"""``surveilnav demo``: one search in a simulated home, every service its own process, judged by the simulator."""

from __future__ import annotations

import json
import time
import uuid
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from surveilnav.bus import Node, Refused, clock_ns
from surveilnav.bus.router import free_port
from surveilnav.cli.evidence import actions, deciding_views, layers, objects, trajectory
from surveilnav.cli.expired_runs import remove_expired_runs
from surveilnav.cli.map_watch import MapWatch
from surveilnav.cli.progress import bar
from surveilnav.cli.recorder import Recorder
from surveilnav.cli.report.page import write_report
from surveilnav.cli.report.record import RunRecord, run_json, traffic_lines
from surveilnav.cli.report.words import outcome as in_words
from surveilnav.cli.stack import Stack, environment
from surveilnav.cli.words import human_bytes
from surveilnav.contract import MISSION_CANCEL, MISSION_GOAL, RECORDINGS
from surveilnav.errors import BusError, MissionError, SurveilNavError
from surveilnav.messages import MissionCancel, MissionGoal, MissionStatus
from surveilnav.pictures import PictureSettings
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.world.goals import Goals, Start, Verdict, find_goals, judge, sample_start
from surveilnav.simulator.world.polygons import contains

ROBOT = "r1"
_READY_S = 180.0
_CLOSED_S = 15.0


@dataclass(frozen=True)
class DemoOptions:
    building: str
    seed: int
    target: str
    perception: str
    surveillance: bool
    cameras: int | None
    area_per_camera_m2: float
    cameras_everywhere: bool
    max_steps: int
    runs: Path
    record: bool = False


def run_demo(options: DemoOptions, console: Console) -> dict[str, Any]:
    """Prepares the building, starts the system, searches, judges, and writes the run's folder.

    Returns:
        The fields of ``run.json``.

    Raises:
        SurveilNavError: a user's mistake, or a service that ended; its text says what to do.
    """
    began_s, started = time.monotonic(), datetime.now(UTC)
    if removed := remove_expired_runs(options.runs, PictureSettings().keep_s):
        console.print(f"removed {removed} old runs from {options.runs} (SURVEILNAV_PICTURES__KEEP_H)", markup=False)
    prepared = _prepare(options, console)
    run_dir = options.runs / f"{started:%Y%m%d-%H%M%S}-{uuid.uuid4().hex[:4]}"
    try:
        record = _play(options, *prepared, run_dir, started, console)
    except KeyboardInterrupt:
        console.print(f"interrupted; logs are in {run_dir / 'logs'}")
        raise
    record.seconds = time.monotonic() - began_s
    report = run_dir / "report.html"
    write_report(record, report)
    outcome = run_json(record, report.resolve())
    (run_dir / "run.json").write_text(json.dumps(outcome, indent=2) + "\n")
    _say(outcome, record, console)
    return outcome


def _prepare(options: DemoOptions, console: Console) -> tuple[SimulatedBuilding, Goals, Start]:
    console.print(f"building: [bold]{escape(options.building)}[/] seed {options.seed}")
    settings = SimulationSettings(
        building=options.building,
        seed=options.seed,
        area_per_camera_m2=options.area_per_camera_m2,
        cameras=options.cameras if options.surveillance else 0,
        cameras_everywhere=options.cameras_everywhere,
    )
    with bar(console) as progress:
        building = SimulatedBuilding(settings, progress)
        goals = find_goals(building.scene, building.navigation, options.target, caster=building.caster)
        start = sample_start(building.scene, building.navigation, goals, seed=options.seed, caster=building.caster)
        building.prepare()
    for note in (*building.notes, *start.notes):
        console.print(f"note: {note}", markup=False)
    console.print(
        f"target: [bold]{goals.label}[/] ({len(goals.instances)} in the building, the nearest {start.shortest_path_m:.1f} m "
        f"away and {'in sight' if start.notes else 'out of sight'})"
    )
    return building, goals, start


def _play(
    options: DemoOptions,
    building: SimulatedBuilding,
    goals: Goals,
    start: Start,
    run_dir: Path,
    started: datetime,
    console: Console,
) -> RunRecord:
    """The search itself: from the start of the services to what the report needs of them."""
    cameras = [camera.name for camera in building.plan.cameras] if options.surveillance else []
    variables = _variables(options, start, run_dir)
    with (
        Stack(variables, run_dir / "logs", cameras, recorder=options.record) as stack,
        Node("cli", "demo", stack.bus, alive=False) as node,
    ):
        with console.status("starting the services") as spinner:
            stack.wait_ready(node, _READY_S, spinner.update)
        recorder = Recorder(node, f"demo-{uuid.uuid4().hex[:8]}", ROBOT)
        backend, why = recorder.perception()
        console.print(f"perception: [bold]{backend}[/] ({escape(why)})")
        with MapWatch(node, recorder.mapped) as maps:
            status = _search(node, stack, recorder, options, goals.label, console)
        verdict = _judge(recorder, status, goals, start)
        if options.record:
            _say_recording(node, recorder.mission, variables["SURVEILNAV_RECORDER__FOLDER"], console)
        record = _record(options, building, recorder, node, status, verdict, start, started)
        record.map_moments = maps.moments
        record.room = _room_of(record, building)
        return record


def _variables(options: DemoOptions, start: Start, run_dir: Path) -> dict[str, str]:
    return environment(
        router=f"tcp/127.0.0.1:{free_port()}",
        building=options.building,
        seed=options.seed,
        cameras=options.cameras,
        area_per_camera_m2=options.area_per_camera_m2,
        perception=options.perception,
        surveillance=options.surveillance,
        state=run_dir / "state",
        cameras_everywhere=options.cameras_everywhere,
        recordings=options.runs / "recordings",
        robot_start=start.setting(),
    )


def _search(
    node: Node, stack: Stack, recorder: Recorder, options: DemoOptions, target: str, console: Console
) -> MissionStatus:
    goal = MissionGoal(
        stamp_ns=clock_ns(), mission=recorder.mission, target=target, robot=ROBOT, max_steps=options.max_steps
    )
    _submit(node, goal, stack)
    with console.status("searching") as spinner:

        def show(status: MissionStatus) -> None:
            """A line of progress."""
            left = f", {status.distance_remaining_m:.1f} m to go" if status.distance_remaining_m is not None else ""
            walked = f"step {status.step}/{status.max_steps}, {status.path_m:.1f} m{left}"
            text = f"{status.phase}: {walked}  {status.message}"
            spinner.update(escape(text))
            if not console.is_terminal and (status.step % 10 == 0 or status.state != "active"):
                console.print("  " + text, markup=False)

        try:
            return recorder.watch(show, stack.check)
        except KeyboardInterrupt:
            cancel = MissionCancel(stamp_ns=clock_ns(), mission=recorder.mission, reason="interrupted")
            node.ask(MISSION_CANCEL, cancel, mission=recorder.mission)
            raise


def _submit(node: Node, goal: MissionGoal, stack: Stack) -> None:
    """Hands the goal over; the planner may still be meeting the robot."""
    until_s = time.monotonic() + 30.0
    while True:
        stack.check()
        try:
            ack = node.ask(MISSION_GOAL, goal, mission=goal.mission).message
        except Refused as error:
            raise MissionError(error.name, str(error)) from error
        except BusError:
            if time.monotonic() > until_s:
                raise
            continue
        if ack.accepted:
            return
        if ack.error != "no_free_robot" or time.monotonic() > until_s:
            raise MissionError(ack.error, ack.message)
        time.sleep(0.2)


def _say_recording(node: Node, mission: str, folder: str, console: Console) -> None:
    """Where the mission's recording is, once it is closed."""
    until_s = time.monotonic() + _CLOSED_S
    while time.monotonic() < until_s:
        try:
            told = node.ask(RECORDINGS, recorder="recorder").message.recordings
        except BusError as error:
            console.print(f"recording: {error}", markup=False)
            return
        if ids := [r.id for r in told if r.mission == mission and r.state == "complete"]:
            console.print(f"recording: {folder}/{ids[0]}.mcap", markup=False, soft_wrap=True)
            return
        time.sleep(0.1)
    console.print(f"recording: not closed within {_CLOSED_S:g} s; it is in {folder}", markup=False, soft_wrap=True)


def _judge(recorder: Recorder, status: MissionStatus, goals: Goals, start: Start) -> Verdict:
    """The simulator's own check at the robot's last pose. A mission that found nothing is a failure wherever it ended."""
    last = recorder.observations[max(recorder.observations)][0] if recorder.observations else None
    if last is None:
        raise SurveilNavError("the robot was never heard of: see its log")
    state = SimpleNamespace(
        p_world=last.T_world_base.translation_m,
        floor=last.floor,
        path_m=last.path_m,
        stopped=has_found(status) and last.last_action == "stop",
    )
    return judge(goals, state, shortest_path_m=start.shortest_path_m)


def has_found(status: MissionStatus) -> bool:
    """Whether a mission ended because it found its target, as it says."""
    return status.state == "done" and status.found


def _record(
    options: DemoOptions,
    building: SimulatedBuilding,
    recorder: Recorder,
    node: Node,
    status: MissionStatus,
    verdict: Verdict,
    start: Start,
    started: datetime,
) -> RunRecord:
    floors = [revision.floor for revision in recorder.revisions()]
    known = [o for floor in floors for o in objects(node, floor)]
    backend, why = recorder.perception()
    return RunRecord(
        building=building.scene.name,
        seed=options.seed,
        target=status.target,
        perception=backend,
        perception_why=why,
        surveillance=options.surveillance,
        started=started,
        seconds=0.0,
        status=status,
        verdict={
            "found": has_found(status),
            "success": verdict.success,
            "steps": status.step,
            "spl": verdict.spl,
            "soft_spl": verdict.soft_spl,
            "path_m": verdict.path_m,
            "shortest_path_m": verdict.shortest_path_m,
            "distance_to_viewpoint_m": verdict.distance_to_viewpoint_m,
            "success_at_0_2_m": verdict.success_at_0_2_m,
            "success_at_1_m": verdict.success_at_1_m,
        },
        trajectory=trajectory(recorder),
        actions=actions(recorder),
        plans=[recorder.plans[seq] for seq in sorted(recorder.plans)],
        layers={floor: layers(node, floor, status.target) for floor in floors},
        cameras=recorder.camera_infos(),
        invoked=recorder.invoked_cameras(),
        objects=known,
        deciding_views=deciding_views(node, recorder, known, status),
        traffic=traffic_lines(recorder.traffic()),
        notes=[*building.notes, *start.notes],
    )


def _room_of(record: RunRecord, building: SimulatedBuilding) -> str:
    """The room that the object stands in; else the one that the robot ended in."""
    ends = [(s.floor, (s.x_m, s.y_m)) for s in record.trajectory[-1:]]
    places = [(o.floor, o.center_m[:2]) for o in (record.chosen,) if o is not None] + ends
    for floor, at_m in places:
        for room in building.scene.rooms:
            if room.name and room.floor == floor and contains(np.array(room.polygon_m), np.array(at_m)):
                return room.name
    return ""


def _say(outcome: dict[str, Any], record: RunRecord, console: Console) -> None:
    tone, sentence = in_words(record)
    console.print(f"[{'green' if tone == 'good' else 'red'}]{escape(sentence)}[/]")
    traffic = outcome["traffic"]
    wire = human_bytes(traffic["wire"]) if traffic["wire"] is not None else "unknown"
    console.print(
        f"SPL {outcome['spl']:.2f}; {outcome['cameras']} cameras, {len(outcome['invoked_cameras'])} invoked; offered "
        f"{human_bytes(traffic['offered'])}, delivered {human_bytes(traffic['delivered'])}, wire {wire}; "
        f"{outcome['seconds']:.0f} s"
    )
    console.print(f"report: {outcome['report']}")
