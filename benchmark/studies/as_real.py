"""The same searches with everything simulated, and with hardware that is met by RTSP and ROS 2 alone.

    python -m surveilnav.benchmark.studies.as_real --buildings flats_200 flats_201 ... [--targets tv bed] [--seeds 0]

Each start is played twice on the real clock, with empty maps: by ``surveilnav demo``, whose cameras measure depth and whose robot
takes one action at a time; and by ``surveilnav up --as-real``, whose cameras are RTSP streams without depth and whose robot
drives by Nav2's action, knows itself by a localisation with noise, and has a map of its own. The second robot is judged where it
is in truth. Each search is a row of a file in ``--data``, so a second start plays only what is missing. The page goes to
``--page``.
"""

from __future__ import annotations

import argparse
import math
import os
import shlex
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from surveilnav.benchmark.canary import digest
from surveilnav.benchmark.runner.summary import interval
from surveilnav.benchmark.studies import live
from surveilnav.benchmark.studies.rows import RowsFile
from surveilnav.bus.router import free_port
from surveilnav.client import Client
from surveilnav.contract import MISSION_PLAN, VIEW_LOG
from surveilnav.errors import SurveilNavError
from surveilnav.messages import FrameHeader
from surveilnav.robot_file import load_robot
from surveilnav.robot_state import RobotState
from surveilnav.ros2.session import RosMessage, RosSession
from surveilnav.services.recorder.recorded import RecordedMessage, read_recording
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.world.goals import Goals, Start, find_goals, judge, sample_start

WIRINGS = ("simulated", "as-real")
KEY = ("building", "seed", "target", "wiring")
_READY_S, _LONGEST_S = 300.0, 600.0


class Truth:
    """Where the robot is in truth, and how far it has gone, as its own hardware says to a judge alone."""

    def __init__(self) -> None:
        self.pose: tuple[float, float, float] | None = None
        self.floor, self.path_m = "0", 0.0

    def on_odometry(self, message: RosMessage) -> None:
        """Takes a message of ``/ground_truth``."""
        pose = message.data.pose.pose
        x_m, y_m = pose.position.x, pose.position.y
        if self.pose is not None:
            self.path_m += math.dist(self.pose[:2], (x_m, y_m))
        self.pose = x_m, y_m, 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        self.floor = message.data.header.frame_id.rpartition("/")[2]


def play(building: str, seed: int, target: str, wiring: str, data: Path, cameras: int | None = None) -> dict[str, Any]:
    """Plays a search and returns its row; a search that can't be played has the reason in "skipped".

    ``cameras``: how many, as real; None: one for each 100 square metres.
    """
    key = {"building": building, "seed": seed, "target": target, "wiring": wiring}
    if wiring == "simulated":
        row = live.play(live.Search(building, seed, target, "on"), "compact", data / "runs")
        return row | key
    try:
        home = SimulatedBuilding(SimulationSettings(building=building, seed=seed))
        goals = find_goals(home.scene, home.navigation, target, caster=home.caster)
        start = sample_start(home.scene, home.navigation, goals, seed=seed, caster=home.caster)
        folder = data / "as-real" / f"{building}-{seed}-{target}".replace(" ", "_")
        with running(building, seed, start, folder, cameras) as (client, bus):
            row = key | search(client, bus, goals, start, folder) | {"program": digest()}
        for recording in (folder.parent / "recordings").glob(f"*{row.pop('mission')}*.mcap"):
            row |= {"decision_s": decision_times_s(recording)}
        return row
    except SurveilNavError as error:
        return key | {"skipped": str(error)}


@contextmanager
def running(
    building: str, seed: int, start: Start, folder: Path, cameras: int | None = None
) -> Iterator[tuple[Client, str]]:
    """``surveilnav up --as-real`` with the robot at its start.

    Yields a client, once a mission could run, and the endpoint of the bus.
    """
    folder.mkdir(parents=True, exist_ok=True)
    port, bus = free_port(), f"tcp/127.0.0.1:{free_port()}"
    program = [str(Path(sys.executable).parent / "surveilnav"), "up", "--as-real", "--building", building]
    program += ["--seed", str(seed), "--perception", "compact", "--logs", str(folder)]
    program += ["--port", str(port), "--router", bus, *(["--cameras", str(cameras)] if cameras is not None else [])]
    with (folder / "up.log").open("w") as out:
        process = subprocess.Popen(
            program, stdout=out, stderr=out, env=os.environ | {"SURVEILNAV_ROBOT_HARDWARE__START": start.setting()}
        )
        try:
            with Client(f"http://127.0.0.1:{port}") as client:
                _wait_ready(client, process, folder)
                yield client, bus
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(60.0)
            except subprocess.TimeoutExpired:  # its services end with it
                process.kill()
                process.wait()


def _wait_ready(client: Client, process: subprocess.Popen[bytes], folder: Path) -> None:
    deadline_s = time.monotonic() + _READY_S
    while True:
        try:
            missing = client.readiness().missing
            if not missing and any(robot.seq for robot in client.robots()):
                return
        except SurveilNavError as error:
            missing = [str(error)]
        if process.poll() is not None or time.monotonic() > deadline_s:
            raise SurveilNavError(
                f"`surveilnav up --as-real` isn't ready: {', '.join(missing)}; see {folder / 'up.log'}"
            )
        time.sleep(0.2)


def search(client: Client, bus: str, goals: Goals, start: Start, folder: Path) -> dict[str, Any]:
    """One mission, judged where the robot is in truth."""
    truth = Truth()
    robot = load_robot(folder / "hardware" / "robots" / "r1.yaml")
    with RosSession("judge", router=robot.router, domain=robot.domain) as session:
        session.subscribe("/ground_truth", "nav_msgs/msg/Odometry", truth.on_odometry)
        began_s, before_s = time.monotonic(), processor_time_s(bus)
        mission = client.submit(goals.label)
        while not mission.has_ended and time.monotonic() < began_s + _LONGEST_S:
            time.sleep(0.1)
            mission = client.mission(mission.id)
        search_s = time.monotonic() - began_s
        if not mission.has_ended:
            client.cancel(mission.id, "too long")
        pose, after_s = truth.pose, processor_time_s(bus)
    if pose is None:
        raise SurveilNavError("the robot's hardware never said where it is")
    z_m = start.p_m[2]
    stands = RobotState(pose[0], pose[1], z_m, truth.floor, pose[2], stopped=mission.found, path_m=truth.path_m)
    verdict = judge(goals, stands, shortest_path_m=start.shortest_path_m)
    said: dict[str, Any] = {
        "found": mission.found,
        "error": mission.error,
        "message": mission.message,
        "steps": mission.step,
    }
    said |= {"search_s": search_s, "mission": mission.id}
    said |= {"cpu_s": {name: round(after_s[name] - before_s.get(name, 0.0), 2) for name in after_s}}
    return said | asdict(verdict)


def processor_time_s(bus: str) -> dict[str, float]:
    """What the services on a bus have spent on processors so far [s], by module."""
    spent: dict[str, float] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            words = (folder / "cmdline").read_bytes().decode(errors="replace").split("\0")
            module = words[2] if words[1:2] == ["-m"] and len(words) > 2 else ""
            if module.startswith("surveilnav.services") and bus.encode() in (folder / "environ").read_bytes():
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
                seconds = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
                spent[module] = spent.get(module, 0.0) + seconds
    return spent


def decision_times_s(recording: Path) -> list[tuple[float, bool]]:
    """Of each decision of a recorded mission, how long after the observation that it is based on it was made [s].

    True beside it: its waypoint lies elsewhere than that of the decision before, by half a metre or more.
    """
    observed_ns, times_s = dict[int, int](), list[tuple[float, bool]]()
    last: tuple[float, float] | None = None
    for heard in read_recording(recording):
        if not isinstance(heard, RecordedMessage):
            continue
        if heard.stream is VIEW_LOG and heard.message.source.startswith("robot/") and heard.message.header:
            header = msgspec.msgpack.decode(heard.message.header, type=FrameHeader)
            observed_ns[header.seq] = header.stamp_ns
        elif heard.stream is MISSION_PLAN and heard.message.seq in observed_ns and heard.message.waypoint:
            plan = heard.message
            to = plan.waypoint.x_m, plan.waypoint.y_m
            times_s.append(
                ((plan.stamp_ns - observed_ns[plan.seq]) / 1e9, last is not None and math.dist(to, last) >= 0.5)
            )
            last = to
    return times_s


# --- the page -----------------------------------------------------------------------------------------------------


def page(rows: Sequence[dict[str, Any]], command: str) -> str:
    """The page in Markdown."""
    played = {tuple(r[k] for k in KEY): r for r in rows if "skipped" not in r}
    pairs = [
        (row, played[(*key[:3], "simulated")])
        for key, row in sorted(played.items())
        if key[3] == "as-real" and (*key[:3], "simulated") in played
    ]
    lines = ["# The same searches with simulated wiring and with hardware", ""]
    if not pairs:
        return "\n".join([*lines, "Nothing was played both ways yet.", ""])
    scenes = [real["building"] for real, _ in pairs]
    lines += [
        f"**{len(pairs)} starts in {len(set(scenes))} buildings, each played both ways.** With hardware in place of simulated "
        f"wiring success changes by {_change(pairs, scenes, 'success')} points and SPL by {_change(pairs, scenes, 'spl')} "
        "(mean and 95 % interval over buildings).",
        "",
        f"Made by `{command}`, programs {', '.join(sorted({r['program'] for pair in pairs for r in pair}))}.",
        "",
        "| wiring | success | SPL | said to be found | time, median | decisions, median | way, median |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, arm in (("as real", [p[0] for p in pairs]), ("simulated", [p[1] for p in pairs])):
        lines.append(
            f"| {name} | {sum(r['success'] for r in arm)} of {len(arm)} | {100 * statistics.mean(r['spl'] for r in arm):.1f} | "
            f"{sum(bool(r['found']) for r in arm)} | {statistics.median(r['search_s'] for r in arm):.0f} s | "
            f"{statistics.median(r['steps'] for r in arm):.0f} | {statistics.median(r['path_m'] for r in arm):.1f} m |"
        )
    lines += ["", *_costs([real for real, _ in pairs])]
    lines += [
        "",
        "| building | seed | target | success as real / simulated | way [m] | shortest [m] | time [s] | as real it said |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for real, simulated in pairs:
        right = " / ".join("yes" if r["success"] else "no" for r in (real, simulated))
        way = f"{real['path_m']:.1f} / {simulated['path_m']:.1f}"
        lines.append(
            f"| {real['building']} | {real['seed']} | {real['target']} | {right} | {way} | "
            f"{real['shortest_path_m']:.1f} | {real['search_s']:.0f} / {simulated['search_s']:.0f} | {real['message']} |"
        )
    skipped = [r for r in rows if "skipped" in r]
    lines += ["", "## Not played", ""] if skipped else []
    lines += [f"- {r['building']}, seed {r['seed']}, {r['target']}, {r['wiring']}: {r['skipped']}" for r in skipped]
    return "\n".join([*lines, ""])


def _costs(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What the searches as real cost, and how long their decisions took."""
    times = [(t, moved) for r in rows for t, moved in r.get("decision_s", [])]
    for name, some in (("a decision", [t for t, _ in times]), ("another waypoint", [t for t, moved in times if moved])):
        if some:
            yield (
                f"From an observation of the robot as real to {name}: median {statistics.median(some):.2f} s, "
                f"9 of 10 within {statistics.quantiles(some, n=10)[-1] if len(some) > 1 else some[0]:.2f} s ({len(some)})."
            )
    spent: dict[str, float] = {}
    for row in rows:
        for module, cpu_s in row.get("cpu_s", {}).items():
            spent[module] = spent.get(module, 0.0) + cpu_s
    total_s = sum(r["search_s"] for r in rows)
    shares = [
        f"{m.rpartition('.')[2]} {100 * s / total_s:.0f} %" for m, s in sorted(spent.items(), key=lambda e: -e[1])
    ]
    yield f"Of a core, while searching as real: {', '.join(shares)}."


def _change(pairs: Sequence[tuple[dict[str, Any], dict[str, Any]]], scenes: Sequence[str], name: str) -> str:
    value = interval([100.0 * (real[name] - simulated[name]) for real, simulated in pairs], list(scenes))
    return f"{value.mean:+.1f} [{value.low:+.1f}, {value.high:+.1f}]"


def main(argv: Sequence[str] | None = None) -> int:
    """Plays what is missing, one search after the other, and writes the page after each."""
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.as_real", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("--buildings", nargs="+", required=True)
    parser.add_argument("--targets", nargs="+", required=True)
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--wirings", nargs="+", choices=WIRINGS, default=list(WIRINGS))
    parser.add_argument("--cameras", type=int, help="how many, as real; by default one for each 100 square metres")
    parser.add_argument("--data", type=Path, default=Path("runs/as_real"))
    parser.add_argument("--page", type=Path, default=Path("docs/results/as_real.md"))
    args = parser.parse_args(argv)
    args.data.mkdir(parents=True, exist_ok=True)
    rows = RowsFile(args.data / "rows.jsonl", KEY)
    words = [
        word for name in ("buildings", "targets", "seeds") for word in (f"--{name}", *map(str, getattr(args, name)))
    ]
    command = f"{parser.prog} {shlex.join(words)}"
    wanted = [(b, s, t, w) for b in args.buildings for s in args.seeds for t in args.targets for w in args.wirings]
    missing = [key for key in wanted if key not in rows.done()]
    began_s = time.monotonic()
    for number, (building, seed, target, wiring) in enumerate(missing, start=1):
        row = play(building, seed, target, wiring, args.data, args.cameras)
        rows.append(row)
        args.page.write_text(page(rows.load(), command), encoding="utf-8")
        left_s = (time.monotonic() - began_s) / number * (len(missing) - number)
        said = row.get("skipped") or f"{'right' if row['success'] else 'wrong'} in {row['search_s']:.0f} s"
        print(
            f"{number} of {len(missing)} {building} {seed} {target} {wiring}: {said}; {left_s / 60:.0f} min left",
            flush=True,
        )
    args.page.write_text(page(rows.load(), command), encoding="utf-8")
    return 0


if __name__ == "__main__":
    os.environ.setdefault("NO_COLOR", "1")
    sys.exit(main())
