"""`kill -9` of every service under `surveilnav up`: seconds until it is back, and how the mission ended. Prints a page.

.venv/bin/python -m tests.bench.bench_kills [--repeats 5] > docs/results/restarts.md

A mission for each service, in turn a tv and a bed, from one corner of the flat to the other. The first run kills nobody: its
missions say how each should end. Every other run begins with other services, so each is killed while the flat is unknown, too.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
import tempfile
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from statistics import median

from tests.e2e.kills import SERVICES, Up, up

TARGETS = ("tv", "bed")
#: The service is killed when the mission has made about so many steps.
KILLED_AT_STEP = 8


@dataclass(frozen=True, slots=True)
class Ended:
    """How a mission ended. ``back_s``: until the service that was killed was back; NaN: none was."""

    killed: str
    back_s: float
    state: str
    found: bool
    steps: int


def one_run(folder: Path, victims: list[str]) -> list[Ended]:
    """A mission for each of ``victims`` ("": nobody) on one system, the flat unknown to the first."""
    with up(folder) as system:
        return [one_mission(system, victim, target) for victim, target in zip(victims, cycle(TARGETS))]


def one_mission(system: Up, victim: str, target: str) -> Ended:
    """Kills ``victim`` in the midst of a search."""
    id, back_s = system.search(target), math.nan
    system.goes_on(id, KILLED_AT_STEP)
    if victim:
        back_s = system.kill(victim)
    end = system.end(id)
    ended = Ended(victim, back_s, end["state"], end["found"], end["step"])
    print(f"{victim or 'nobody'}: back in {back_s:.1f} s; {ended}", file=sys.stderr, flush=True)
    return ended


def page(plain: list[Ended], runs: list[list[Ended]]) -> str:
    """The results as Markdown."""
    killed = {name: [e for run in runs for e in run if e.killed == name] for name in SERVICES}
    rows = "\n".join(_row(name, ended) for name, ended in killed.items())
    return f"""# Killed services

Every service of `surveilnav up` was killed with `kill -9` in the midst of a search, at about step {KILLED_AT_STEP}. It counts as
back when a new process runs and the gateway hears of it.

| killed | times | back after, median [s] | longest [s] | found its target | steps |
|---|---|---|---|---|---|
{rows}
| nobody | {len(plain)} | | | {sum(e.found for e in plain)} | {_steps(plain)} |

The searches go from the tv to the bed and back. The first of each run is in a flat that nobody knows yet, so it may take longer.
When a camera's view arrives is a matter of milliseconds, so searches differ by some steps with nobody killed, too.
A service is started again half a second after its death; the rest is its own start.

Flat `parametric_flat`, perception `oracle`, two cameras, {os.cpu_count()} processor cores that other work kept busy.
Made by `python -m tests.bench.bench_kills`.
"""


def _row(name: str, ended: list[Ended]) -> str:
    """A line of the table: the searches in which ``name`` was killed."""
    backs_s, found = [e.back_s for e in ended], sum(e.found for e in ended)
    kind = name.partition("-")[0]
    return f"| {kind} | {len(ended)} | {median(backs_s):.1f} | {max(backs_s):.1f} | {found} | {_steps(ended)} |"


def _steps(ended: list[Ended]) -> str:
    """The least and the most steps of searches."""
    return f"{min(e.steps for e in ended)} to {max(e.steps for e in ended)}"


def main() -> None:
    """Plays the runs and prints the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=5, help="how often each service is killed")
    arguments = parser.parse_args()
    names = list(SERVICES)
    with tempfile.TemporaryDirectory() as folder:
        plain = one_run(Path(folder) / "plain", [""] * len(names))
        runs = [one_run(Path(folder) / str(n), names[n:] + names[:n]) for n in range(arguments.repeats)]
    print(page(plain, runs), end="")


if __name__ == "__main__":
    main()
