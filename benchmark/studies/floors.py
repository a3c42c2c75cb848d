"""The target is on another floor: every example home with stairs x every target that the start's floor lacks.

    python -m surveilnav.benchmark.studies.floors --out docs/results/floors

Each search is played twice: with the summaries that all floors' cameras report, and without (the cameras of the robot's
floor work in both). Resumable: a finished search is a line of ``episodes.jsonl``; ``README.md`` is written anew after
each, with a picture of every search beside it.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.benchmark.studies.rows import Rows
from surveilnav.errors import SurveilNavError, TargetError
from surveilnav.simulator.furniture.labels import TARGETS

if TYPE_CHECKING:
    from surveilnav.benchmark.play.episode import EpisodeResult
    from surveilnav.geometry import Grid
    from surveilnav.services.planner.core.memory.floor_goal import FloorChange
    from surveilnav.simulator.simulation import SimulatedBuilding
    from surveilnav.simulator.world.free_ground import FloorNavigation
    from surveilnav.simulator.world.goals import Goals, Start
    from surveilnav.simulator.world.navigation import NavigationMap

HOMES = ("2_bedroom_basement", "3_bedroom_attic", "3_bedroom_mezzanine")
ARMS = ("with", "without")
KEY = ("building", "seed", "target", "start", "summaries")


def elsewhere(navigation: NavigationMap, goals: Goals) -> Iterator[str]:
    """Floors to start from: a robot lives there, it can get to a goal, and none is on that floor."""
    for name, area in navigation.robot_area.items():
        if name not in goals.viewpoints and np.isfinite(goals.field.distance_m[name][area]).any():
            yield name


def start_on(navigation: NavigationMap, goals: Goals, floor: str, seed: int) -> Start:
    """A place on that floor, indoors if there is any, from which a goal can be got to: drawn by ``seed``."""
    from surveilnav.simulator.world.goals import Start

    f = navigation.floors[floor]
    ground = navigation.robot_area[floor] & np.isfinite(goals.field.distance_m[floor])
    cells = np.argwhere(ground & f.indoor if (ground & f.indoor).any() else ground)
    rng = np.random.default_rng([seed, *goals.label.encode(), *floor.encode()])
    x, y = (float(v) for v in f.grid.centres_of(cells[rng.integers(len(cells))]))
    yaw_rad = float(rng.uniform(-np.pi, np.pi))
    return Start((x, y, f.z_m), floor, yaw_rad, goals.field.at((x, y), floor))


def run_home(home: str, seed: int, targets: Sequence[str], perception: str, max_steps: int, out: Path) -> None:
    """Plays what is missing of one home, and writes the table after every search."""
    from surveilnav.benchmark.play.episode import Episode
    from surveilnav.benchmark.play.sight import Sight
    from surveilnav.benchmark.policies.mission import Mission
    from surveilnav.benchmark.policies.policy import Task
    from surveilnav.services.planner.core import PlannerConfig
    from surveilnav.services.planner.core.motion.drive import FmmPlanner
    from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
    from surveilnav.simulator.truth.choose import choose_backend
    from surveilnav.simulator.world.goals import find_goals

    building = SimulatedBuilding(SimulationSettings(building=home, seed=seed))
    building.prepare()
    sight, rows = Sight(building, choose_backend(perception)), rows_in(out)
    for target in targets:
        try:
            goals = find_goals(building.scene, building.navigation, target, caster=building.caster)
        except TargetError:
            continue
        for floor, arm in itertools.product(elsewhere(building.navigation, goals), ARMS):
            facts = {"building": home, "seed": seed, "target": target, "start": floor, "summaries": arm}
            if rows.key_of(facts) in rows.done():
                continue
            start = start_on(building.navigation, goals, floor, seed)
            mission = Mission(Task(target, seed, max_steps, FmmPlanner()), PlannerConfig(), summaries=True)
            episode = Episode(sight, goals, start, mission, summaries=arm == "with").run()
            facts["picture"] = keep_picture(out, "-".join((home, target, floor)), arm, picture(building, episode))
            rows.append(facts | record_of(episode, mission.changes, sight.by_floor(), target, sight.backend.name))
            (out / "README.md").write_text(table(rows.load()))


def rows_in(out: Path) -> Rows:
    """The searches of a table's folder."""
    return Rows(out / "episodes.jsonl", KEY)


def record_of(
    episode: EpisodeResult,
    changes: Sequence[FloorChange],
    seen: dict[str, dict[str, float]],
    target: str,
    perception: str,
) -> dict[str, Any]:
    """What the table needs of a search."""
    verdict = episode.verdict
    return {
        "perception": perception,
        "success": verdict.success,
        "found": episode.found,
        "reason": episode.reason,
        "message": episode.message,
        "steps": episode.steps,
        "path_m": round(verdict.path_m, 2),
        "shortest_path_m": round(verdict.shortest_path_m, 2),
        "spl": round(verdict.spl, 4),
        "floors": list(episode.floors),
        "changes": [{"step": c.step, "floor": c.floor, "to_floor": c.to_floor, "why": c.why} for c in changes],
        "seen": {floor: labels.get(target, 0.0) for floor, labels in seen.items()},
        "summary_bytes": episode.summary_bytes,
        "camera_bytes": sum(episode.camera_bytes.values()),
        "invoked": sorted(episode.camera_bytes),
        "seconds": round(episode.seconds, 1),
    }


# --- showing it ---------------------------------------------------------------------------------------------------


def picture(building: SimulatedBuilding, episode: EpisodeResult) -> NDArray[np.uint8]:
    """BGR, the floors that the robot was on side by side: where it can stand light, its way red, from green to blue."""
    sides = []
    where = list(zip(episode.trajectory, episode.trajectory_floors, strict=True))
    for name in dict.fromkeys(episode.floors):
        floor = building.navigation.floors[name]
        image = _plan_of(floor, building.navigation.robot_area[name])
        here = [(x, y) for (x, y, _), on in where if on == name]
        for a, b in itertools.pairwise(here):
            cv2.line(image, _pixel(floor.grid, a), _pixel(floor.grid, b), (40, 40, 220), 1, cv2.LINE_AA)
        if here:
            cv2.circle(image, _pixel(floor.grid, here[0]), 3, (60, 160, 60), -1)
            cv2.circle(image, _pixel(floor.grid, here[-1]), 3, (200, 80, 40), -1)
        rows, cols = np.nonzero((floor.supported & floor.indoor) | floor.obstacle)
        image = image[max(0, rows.min() - 4) : rows.max() + 5, max(0, cols.min() - 4) : cols.max() + 5][::-1]
        image = np.ascontiguousarray(np.pad(image, ((16, 4), (4, 4), (0, 0)), constant_values=255))
        cv2.putText(image, f"floor {name}", (6, 12), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (60, 60, 60), 1, cv2.LINE_AA)
        sides.append(image)
    height = max(s.shape[0] for s in sides)
    joined = np.hstack([np.pad(s, ((0, height - s.shape[0]), (0, 0), (0, 0)), constant_values=255) for s in sides])
    return np.asarray(cv2.resize(joined, None, fx=2.0, fy=2.0, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def keep_picture(out: Path, search: str, arm: str, image: NDArray[np.uint8]) -> str:
    """Writes a search's picture, or finds that the other arm's is the same; its file's name."""
    _, png = cv2.imencode(".png", image)
    names = [f"{search}-{a}.png".replace(" ", "_") for a in ARMS]
    for name in names:
        if (out / name).exists() and (out / name).read_bytes() == png.tobytes():
            return name
    own = names[ARMS.index(arm)]
    (out / own).write_bytes(png.tobytes())
    return own


def _plan_of(floor: FloorNavigation, area: NDArray[np.bool_]) -> NDArray[np.uint8]:
    image = np.full((*floor.grid.shape, 3), 255, np.uint8)
    image[floor.supported] = 225
    image[area] = 245
    image[floor.obstacle] = 120
    return image


def _pixel(grid: Grid, place: tuple[float, float]) -> tuple[int, int]:
    row, col = grid.cells_of(place)
    return int(col), int(row)


def table(records: Sequence[dict[str, Any]]) -> str:
    """docs/results/floors/README.md."""
    pairs: dict[tuple[Any, ...], dict[str, dict[str, Any]]] = {}
    for r in sorted(records, key=_key_of):
        pairs.setdefault(_key_of(r)[:-1], {})[r["summaries"]] = r
    lines = [
        "# The target is on another floor",
        "",
        "Made by `python -m surveilnav.benchmark.studies.floors`. Every example home with stairs, every target that the start's "
        f"floor lacks; perception {', '.join(sorted({r['perception'] for r in records}))} on rendered pixels. Success: `stop` "
        "within 0.1 m (geodesic) of a viewpoint. With summaries every camera of the building says, in one message of at most 512 "
        "bytes, which labels it last saw how surely; without them a robot searches its own floor first. The cameras of "
        "the floor that the robot is on work in both.",
        "",
        "| summaries | searches | success | SPL | steps (mean) | path (mean) | summaries: bytes (mean) | frames: MB (mean) |",
        "|---|---|---|---|---|---|---|---|",
        *(_arm(arm, [p[arm] for p in pairs.values() if arm in p]) for arm in ARMS),
        "",
        "## Every search",
        "",
        "Steps, path and SPL: with / without summaries.",
        "",
        "| home | target | from | seen by the cameras of | found | steps | path [m] | shortest [m] | SPL | bytes | stairs |",
        "|---|---|---|---|---|---|---|---|---|---|---|",
        *(_search(pair) for pair in pairs.values()),
        "",
        "## Pictures",
        "",
    ]
    return "\n".join([*lines, *_pictures(sorted(records, key=_key_of))])


def _pictures(records: Sequence[dict[str, Any]]) -> list[str]:
    """What happened in every search, and its way; one picture for those that went the same way."""
    lines = []
    for picture, same in itertools.groupby(records, key=lambda r: r["picture"]):
        for r in same:
            lines += [f"{r['target']} in {r['building']}, {r['summaries']} summaries: {_story(r)}", ""]
        lines += [f"![]({picture})", ""]
    return lines


def _key_of(record: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(record[name] for name in KEY)


def _arm(arm: str, rows: Sequence[dict[str, Any]]) -> str:
    if not rows:
        return f"| {arm} | 0 |" + " - |" * 6
    n = len(rows)
    mean = {k: sum(r[k] for r in rows) / n for k in ("spl", "steps", "path_m", "camera_bytes")}
    told = sum(sum(r["summary_bytes"].values()) for r in rows) / n
    return (
        f"| {arm} | {n} | {sum(r['success'] for r in rows)} | {100 * mean['spl']:.1f} | {mean['steps']:.0f} "
        f"| {mean['path_m']:.1f} m | {told:.0f} | {mean['camera_bytes'] / 1e6:.1f} |"
    )


def _search(pair: dict[str, dict[str, Any]]) -> str:
    one = next(iter(pair.values()))

    def both(field: str, digits: int) -> str:
        return " / ".join(f"{pair[arm][field]:.{digits}f}" if arm in pair else "-" for arm in ARMS)

    found = " / ".join(("yes" if pair[a]["success"] else pair[a]["reason"]) if a in pair else "-" for a in ARMS)
    seen = ", ".join(f"{floor} ({score:.2f})" for floor, score in sorted(one["seen"].items()) if score) or "none"
    told = sum(pair["with"]["summary_bytes"].values()) if "with" in pair else 0
    stairs = " / ".join("-".join(pair[a]["floors"]) if a in pair else "-" for a in ARMS)
    cells = (
        one["building"],
        one["target"],
        one["start"],
        seen,
        found,
        both("steps", 0),
        both("path_m", 1),
        f"{one['shortest_path_m']:.1f}",
        both("spl", 2),
        str(told),
        stairs,
    )
    return "| " + " | ".join(cells) + " |"


def _story(record: dict[str, Any]) -> str:
    said = [f"after {c['step']} steps to {c['to_floor']} ({c['why']})" for c in record["changes"]]
    return "; ".join([*said, record["message"]]) + "."


def main(argv: Sequence[str] | None = None) -> int:
    """Plays what is missing, home by home."""
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.floors", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--out", type=Path, default=Path("docs/results/floors"))
    parser.add_argument("--homes", nargs="*", default=list(HOMES))
    parser.add_argument("--targets", nargs="*", default=list(TARGETS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--perception", default="onnx-coco")
    parser.add_argument("--max-steps", type=int, default=500)
    options = parser.parse_args(argv)
    options.out.mkdir(parents=True, exist_ok=True)
    for home in options.homes:
        run_home(home, options.seed, options.targets, options.perception, options.max_steps, options.out)
        print(json.dumps({"home": home, "searches": len(rows_in(options.out).load())}), file=sys.stderr, flush=True)
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SurveilNavError as error:
        sys.exit(f"error: {error}")
