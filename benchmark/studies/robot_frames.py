"""Searches by a robot that isn't where it says: who is named, when, and what it costs.

    python -m surveilnav.benchmark.studies.robot_frames --searches 4 --cameras 6

The golden run's buildings and searches are played with more cameras, by a robot that drives to waypoints and has a localisation
of its own. Its map's place in the building is wrong from the start, or jumps after 3 m. A camera that is put into quarantine then
is accused wrongly: all of them hang where they are described. In two more arms it is the camera nearest to the start that isn't
where it is described, and the robot is healthy.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import median

import msgspec

from surveilnav.benchmark import canary
from surveilnav.benchmark.play.episode import EpisodeResult
from surveilnav.benchmark.play.sight import ROBOT
from surveilnav.benchmark.runner.search import search, sight_of
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.benchmark.studies.bad_cameras import MISTAKES, OneBadCamera
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.fusion.core.views.robot_frames import FrameProblem
from surveilnav.simulator.truth.choose import choose_backend

_HEALTHY = {"sigma_m": 0.03, "sigma_deg": 0.5, "drift": 0.01}
#: A robot that drives to waypoints takes no stairs here.
_WITH_STAIRS = {"2_bedroom_basement"}
#: What is wrong with the robot's localisation, by name.
ARMS: Mapping[str, Mapping[str, float]] = {
    "healthy": _HEALTHY,
    "frame off by 0.2 m and 3 degrees": _HEALTHY | {"frame_m": 0.2, "frame_deg": 3.0},
    "frame off by 0.5 m": _HEALTHY | {"frame_m": 0.5},
    "jump of 0.5 m after 3 m": _HEALTHY | {"jump_m": 0.5, "jump_after_m": 3.0},
    "healthy, a camera turned by 10 degrees": _HEALTHY,
    "healthy, a camera 50 cm beside": _HEALTHY,
}


@dataclass
class Row:
    """What came of the searches of one arm.

    Attributes:
        named_at: observations of the robot until it was named, of those named.
        errors: of these, by how much the correction was wrong [m, degrees].
        n_accused: healthy cameras that were put into quarantine.
        n_bad: wrong cameras that were.
    """

    results: list[EpisodeResult] = field(default_factory=list)
    named_at: list[int] = field(default_factory=list)
    errors: list[tuple[float, float]] = field(default_factory=list)
    n_accused: int = 0
    n_bad: int = 0

    def text(self, name: str) -> str:
        n = len(self.results)
        at = f"{median(self.named_at):.0f}" if self.named_at else "–"
        error = "–"
        if self.errors:
            error = f"{median(m for m, _ in self.errors):.2f} m, {median(deg for _, deg in self.errors):.1f}°"
        found = sum(r.verdict.success for r in self.results)
        steps = median(r.steps for r in self.results) if n else 0
        bad = f"{self.n_bad} of {n}" if "camera" in name else "–"
        named = f"{len(self.named_at)} of {n}"
        return f"| {name} | {named} | {at} | {error} | {self.n_accused} | {bad} | {found} of {n} | {steps:.0f} |"


HEADER = (
    "| the robot | named | after so many of its views | error of the correction | healthy cameras accused | wrong camera found "
    "| target found | steps, median |\n|---|---|---|---|---|---|---|---|"
)


def play(golden: canary.Search, n_cameras: int, arm: str, row: Row) -> str:
    """Plays one search; returns what happened, for people."""
    settings = msgspec.convert(
        {**golden.run, "drive": "waypoints", "localisation": dict(ARMS[arm]), "max_steps": 300}, RunSettings
    )
    building, goals, start = canary.open_search(golden, n_cameras)
    named: list[tuple[int, FrameProblem]] = []
    accused: set[str] = set()

    def on_step(step: int, view: PosedView, joint: JointMap, *_: object) -> None:
        problem = joint.quarantine.frames.problems().get(f"robot/{ROBOT}")
        if problem is not None and not named:
            named.append((view.seq, problem))
        accused.update(joint.quarantine.reasons())

    sight = sight_of(building, choose_backend("simulated"), settings)
    mistake = next((name for name in MISTAKES if arm.endswith(f"a camera {name}")), "")
    here = [info for info in sight.infos if info.floor == start.floor]
    nearest = min(here, key=lambda info: math.dist(start.p_m[:2], info.views[0].T_world_camera.matrix()[:2, 3])).camera
    result = search(
        sight,
        settings,
        goals,
        start,
        seed=1,
        goal_on_floor=start.floor in goals.viewpoints,
        cameras=OneBadCamera(sight, settings, nearest, MISTAKES[mistake]) if mistake else None,
        on_step=on_step,
    )
    row.results.append(result)
    bad = {f"camera/{nearest}"} if mistake else set()
    row.n_bad += len(accused & bad)
    row.n_accused += len(accused - bad)
    said = "not named"
    if named:
        seq, problem = named[0]
        row.named_at.append(seq)
        row.errors.append(_error(problem, arm))
        deg = math.degrees(problem.dyaw_rad)
        said = f"named at view {seq}: ({problem.dx_m:+.2f}, {problem.dy_m:+.2f}) m, {deg:+.1f} degrees"
    done = result.reason or "found"
    return f"{golden.building}, {arm}: {said}; accused {sorted(accused) or 'none'}; {done}, {result.steps} steps"


def _error(problem: FrameProblem, arm: str) -> tuple[float, float]:
    """By how much a correction is wrong [m, degrees], by the error that the robot was given."""
    error = ARMS[arm]
    off_m = error.get("frame_m", 0.0) + error.get("jump_m", 0.0)
    deg = abs(math.degrees(problem.dyaw_rad) - error.get("frame_deg", 0.0))
    if error.get("frame_deg"):  # turned about the building's origin
        correction = problem.correction
        return abs(math.hypot(correction.x_m, correction.y_m) - off_m), deg
    return abs(math.hypot(problem.dx_m, problem.dy_m) - off_m), deg


def main() -> None:
    parser = argparse.ArgumentParser(prog="robot_frames", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--searches", type=int, default=4)
    parser.add_argument("--skip", type=int, default=0, help="leave out so many of the first searches")
    parser.add_argument("--cameras", type=int, default=6, help="of each building")
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=list(ARMS), metavar="ARM")
    args = parser.parse_args()
    searches = [s for s in canary.read().searches if s.did is not None and s.building not in _WITH_STAIRS]
    searches = [msgspec.structs.replace(s, run={}) for s in searches][args.skip : args.skip + args.searches]
    rows = {arm: Row() for arm in args.arms}
    for golden in searches:
        for arm, row in rows.items():
            print(play(golden, args.cameras, arm, row), flush=True)
    print(f"\n{HEADER}")
    for arm, row in rows.items():
        print(row.text(arm))


if __name__ == "__main__":
    main()
