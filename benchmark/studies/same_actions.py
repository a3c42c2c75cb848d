"""Compares the running system with the benchmark, action by action: searches of ``studies.live`` are played again in one process.

    python -m surveilnav.benchmark.studies.live --buildings parametric_flat --perception oracle ...
    python -m surveilnav.benchmark.studies.same_actions runs/live/oracle.jsonl ...

Both decide with the same cores, so only their inputs can differ: which view arrives when, and the random errors of
``simulated``, which depend on names of views. So only ``oracle`` and pixels are compared. Searches with cameras are
played a third time, with each view integrated at the step of the recording; what differs then isn't due to timing.
"""

from __future__ import annotations

import argparse
import itertools
import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from surveilnav.benchmark.play.sight import Sight
from surveilnav.benchmark.runner.search import search
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.benchmark.studies.arrivals import Arrivals, RecordedCameras
from surveilnav.benchmark.studies.live import KEY
from surveilnav.benchmark.studies.rows import RowsFile
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.truth.choose import choose_backend
from surveilnav.simulator.world.goals import find_goals, sample_start


class Played(NamedTuple):
    """The outcome of a search that was played in one process."""

    actions: list[str]
    success: bool
    spl: float


class Compared(NamedTuple):
    """A search of the running system beside the benchmark's. ``same``: so many first actions are the same; ``live``: how many
    the running system has; ``next_live``, ``next_alone``: the first ones that differ. ``with_live_timing``: beside
    the search where cameras' views come as in the running system; None: nobody knows."""

    row: dict[str, Any]
    alone: Played
    same: int
    live: int
    next_live: str
    next_alone: str
    with_live_timing: Compared | None = None

    @property
    def whole(self) -> bool:
        return self.same == self.live == len(self.alone.actions)


def compared(row: dict[str, Any], alone: Played) -> Compared:
    """A row of ``live`` beside the same search in one process."""
    live = [action for action in row["actions"] if action]
    if not row["found"] and live[-1:] == ["stop"]:  # a mission that failed halts the robot; the benchmark's just ends
        live = live[:-1]
    both = zip(live, alone.actions, strict=False)
    same = next((i for i, (a, b) in enumerate(both) if a != b), min(len(live), len(alone.actions)))
    next_live, next_alone = (more[same] if len(more) > same else "–" for more in (live, alone.actions))
    return Compared(row, alone, same, len(live), next_live, next_alone)


def played(row: dict[str, Any], building: SimulatedBuilding, arrivals: Arrivals | None = None) -> Played:
    """A search in one process, by the settings that the benchmark has, or with views that come by ``arrivals``."""
    goals = find_goals(building.scene, building.navigation, row["target"], caster=building.caster)
    start = sample_start(building.scene, building.navigation, goals, seed=row["seed"], caster=building.caster)
    settings = RunSettings(perception=row["perception"], surveillance=row["surveillance"] == "on")
    sight, actions = Sight(building, choose_backend(row["perception"])), list[str]()
    result = search(
        sight,
        settings,
        goals,
        start,
        seed=row["seed"],
        cameras=RecordedCameras(sight, arrivals) if arrivals else None,
        on_step=lambda *step: actions.append(step[-1].action or ""),
    )
    return Played([action for action in actions if action], result.verdict.success, result.verdict.spl)


def play_and_compare(row: dict[str, Any], building: SimulatedBuilding) -> Compared:
    """A row of ``live`` beside the same search in one process, with cameras also beside the one with live timing."""
    found = compared(row, played(row, building))
    if row["surveillance"] == "off" or "arrivals" not in row:
        return found
    again = compared(row, played(row, building, Arrivals.from_row(row["arrivals"])))
    return found._replace(with_live_timing=again)


def page(found: Sequence[Compared], command: str) -> str:
    """The page in Markdown."""
    whole = ", ".join(f"{said} {sum(c.whole for c in mine)} of {len(mine)}" for said, mine in _by_cameras(found))
    n = sum(c.live for c in found)
    timed = [c.with_live_timing.whole for c in found if c.with_live_timing is not None]
    lines = [
        "# The running system and the benchmark, action by action",
        "",
        f"**Searches that are the same to the last action: {whole}** ({n} actions by the running system). Each began "
        "at one start with empty maps, over Zenoh and in one process. `simulated` isn't compared: its luck depends on names of "
        "views, which differ.",
        "",
        f"Made by `{command}`.",
        "",
        *_by_arm(found),
        "",
        "With cameras it depends on timing which of their views are in the map at an action. The running system looks at as "
        f"many as it has time for. The benchmark looks at {RunSettings().views_per_step} from one action to the next."
        + (
            f" **With live timing {sum(timed)} of {len(timed)} are the same**: each view came into the maps at the step of the "
            "recording."
            if timed
            else ""
        ),
        "",
        "## Every search",
        "",
        "| building | seed | target | cameras | perception | actions live / alone | right | the same | then live / alone | "
        "with live timing |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for c in found:
        r, then = c.row, "" if c.whole else f"{c.next_live} / {c.next_alone}"
        right = " / ".join("yes" if success else "no" for success in (r["success"], c.alone.success))
        lines.append(
            f"| {r['building']} | {r['seed']} | {r['target']} | {r['surveillance']} | {r['perception']} | "
            f"{c.live} / {len(c.alone.actions)} | {right} | {_how_far(c)} | {then} | "
            f"{_how_far(c.with_live_timing)} |"
        )
    return "\n".join([*lines, ""])


def _how_far(c: Compared | None) -> str:
    """So many actions are the same."""
    return "" if c is None else "all" if c.whole else f"the first {c.same}"


def _by_cameras(found: Sequence[Compared]) -> Iterator[tuple[str, list[Compared]]]:
    """The searches without cameras and those with them, where there are any."""
    for cameras, said in (("off", "without cameras"), ("on", "with them")):
        if mine := [c for c in found if c.row["surveillance"] == cameras]:
            yield said, mine


def _by_arm(found: Sequence[Compared]) -> Iterator[str]:
    """How alike they are, by perception and cameras."""
    yield "| perception | cameras | searches | all the same | right or wrong in both | right live / alone | SPL live / alone |"
    yield "|---|---|---|---|---|---|---|"
    arms = sorted(found, key=_arm_of)
    for (perception, cameras), group in itertools.groupby(arms, key=_arm_of):
        mine = list(group)
        alike = sum(c.row["success"] == c.alone.success for c in mine)
        right = f"{sum(c.row['success'] for c in mine)} / {sum(c.alone.success for c in mine)}"
        spl = f"{_mean(c.row['spl'] for c in mine)} / {_mean(c.alone.spl for c in mine)}"
        whole = sum(c.whole for c in mine)
        yield f"| {perception} | {cameras} | {len(mine)} | {whole} | {alike} | {right} | {spl} |"


def _arm_of(c: Compared) -> tuple[str, str]:
    return c.row["perception"], c.row["surveillance"]


def _mean(spl: Iterator[float]) -> str:
    return f"{100.0 * statistics.mean(spl):.1f}"


def main(argv: Sequence[str] | None = None) -> None:
    """Plays the searches of files of rows, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.same_actions", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("rows", type=Path, nargs="+", help="what surveilnav.benchmark.studies.live wrote")
    parser.add_argument("--page", type=Path, default=Path("docs/results/same_actions.md"))
    args = parser.parse_args(argv)
    rows = [row for path in args.rows for row in RowsFile(path, KEY).load() if "skipped" not in row]
    found, buildings = [], dict[tuple[str, int, int, str], SimulatedBuilding]()
    command = " ".join([parser.prog, *map(str, args.rows)])
    for number, row in enumerate(rows, start=1):
        key = row["building"], row["seed"], row["cameras"], row["models"]
        if key not in buildings:
            settings = SimulationSettings(building=key[0], seed=key[1], cameras=key[2], models=key[3])
            buildings = {key: SimulatedBuilding(settings)}
            buildings[key].prepare()
        found.append(play_and_compare(row, buildings[key]))
        told = f"{row['building']} {row['seed']} {row['target']} {row['surveillance']}"
        print(f"{number} of {len(rows)} {told}: {found[-1].same} of {found[-1].live}", flush=True)
        args.page.write_text(page(found, command), encoding="utf-8")


if __name__ == "__main__":
    main()
