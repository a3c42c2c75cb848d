"""Whether the running system and the benchmark do the same: searches of ``benchmark.studies.live`` played again in one process.

    python -m benchmark.studies.live --buildings parametric_flat --perception oracle ...
    python -m benchmark.studies.same_actions runs/live/oracle.jsonl

Both decide by the same cores. What may differ is what comes to them: which view when, and the luck of ``simulated``, which
hangs on names that differ. So ``oracle`` and pixels are compared.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from benchmark.play.sight import Sight
from benchmark.runner.search import search
from benchmark.runner.settings import RunSettings
from benchmark.studies.live import KEY
from benchmark.studies.rows import Rows
from simulator.simulation import SimulatedBuilding, SimulationSettings
from simulator.truth.choose import choose_backend
from simulator.world.goals import find_goals, sample_start


class Compared(NamedTuple):
    """A search of the running system beside the benchmark's. ``same``: so many first actions are the same; ``live``,
    ``alone``: how many there are; ``next_live``, ``next_alone``: the first ones that differ."""

    row: dict[str, Any]
    same: int
    live: int
    alone: int
    next_live: str
    next_alone: str

    @property
    def whole(self) -> bool:
        """All actions are the same."""
        return self.same == self.live == self.alone


def compared(row: dict[str, Any], actions: Sequence[str]) -> Compared:
    """A row of ``live`` beside the actions of the same search in one process."""
    live = [action for action in row["actions"] if action]
    both = zip(live, actions, strict=False)
    same = next((i for i, (a, b) in enumerate(both) if a != b), min(len(live), len(actions)))
    rest = (more[same] if len(more) > same else "–" for more in (live, actions))
    return Compared(row, same, len(live), len(actions), *rest)


def played(row: dict[str, Any], building: SimulatedBuilding) -> list[str]:
    """The actions of a search in one process, by the settings that the benchmark has."""
    goals = find_goals(building.scene, building.navigation, row["target"], caster=building.caster)
    start = sample_start(building.scene, building.navigation, goals, seed=row["seed"], caster=building.caster)
    settings = RunSettings(perception=row["perception"], surveillance=row["surveillance"] == "on")
    actions: list[str] = []
    search(
        Sight(building, choose_backend(row["perception"])), settings, goals, start, seed=row["seed"],
        on_step=lambda *step: actions.append(step[-1].action or ""),
    )  # fmt: skip
    return [action for action in actions if action]


def page(found: Sequence[Compared], command: str) -> str:
    """What it says, in Markdown."""
    whole, n = sum(c.whole for c in found), sum(c.live for c in found)
    lines = [
        "# The running system and the benchmark, action by action", "",
        f"**{whole} of {len(found)} searches are the same to the last action** ({n} actions by the running system). Each began "
        "at one start with empty maps, over Zenoh and in one process. `simulated` isn't compared: its luck hangs on names of "
        "views, which differ.", "",
        f"Made by `{command}`.", "",
        "| building | seed | target | cameras | perception | actions live / alone | the same | then live / alone |",
        "|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for c in found:
        r, then = c.row, "" if c.whole else f"{c.next_live} / {c.next_alone}"
        lines.append(
            f"| {r['building']} | {r['seed']} | {r['target']} | {r['surveillance']} | {r['perception']} | {c.live} / {c.alone} | "
            f"{'all' if c.whole else f'the first {c.same}'} | {then} |"
        )
    return "\n".join([*lines, ""])


def main(argv: Sequence[str] | None = None) -> None:
    """Plays the searches of a file of rows, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmark.studies.same_actions", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("rows", type=Path, help="what benchmark.studies.live wrote")
    parser.add_argument("--page", type=Path, default=Path("docs/results/same_actions.md"))
    args = parser.parse_args(argv)
    found, buildings = [], dict[tuple[str, int, int], SimulatedBuilding]()
    for row in Rows(args.rows, KEY).load():
        if "skipped" in row:
            continue
        key = row["building"], row["seed"], row["cameras"]
        if key not in buildings:
            buildings = {key: SimulatedBuilding(SimulationSettings(building=key[0], seed=key[1], cameras=key[2]))}
            buildings[key].prepare()
        found.append(compared(row, played(row, buildings[key])))
        print(
            f"{row['building']} {row['target']} {row['surveillance']}: {found[-1].same} of {found[-1].live}", flush=True
        )
    args.page.write_text(page(found, f"python -m benchmark.studies.same_actions {args.rows}"), encoding="utf-8")


if __name__ == "__main__":
    main()
