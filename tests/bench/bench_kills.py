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
    pairs = [(e, p) for run in runs for e, p in zip(run, plain, strict=True)]
    rows = [_row(name, [(e, p) for e, p in pairs if e.killed == name]) for name in SERVICES]
    steps = ", ".join(str(p.steps) for p in plain)
    return f"""# Killed services

Every service of `surveilnav up` was killed with `kill -9` in the midst of a search, at about step {KILLED_AT_STEP}. It counts as
back when a new process runs and the gateway hears of it. A search ended as without if it came to the same end as the same
search with nobody killed; the last column says by how many steps it was longer.

| killed | times | back after, median [s] | longest [s] | ended as without | steps more |
|---|---|---|---|---|---|
{chr(10).join(rows)}

Without kills the searches took {steps} steps, and {sum(p.found for p in plain)} of {len(plain)} found their target.
When a camera's view arrives is a matter of milliseconds, so two searches may differ by a few steps with nobody killed.
A service is started again half a second after its death; the rest is its own start.

Flat `parametric_flat`, perception `oracle`, two cameras, {os.cpu_count()} processor cores that other work kept busy.
Made by `python -m tests.bench.bench_kills`.
"""


def _row(name: str, pairs: list[tuple[Ended, Ended]]) -> str:
    """A line of the table: missions in which ``name`` was killed, and the same without."""
    backs_s, more = [e.back_s for e, _ in pairs], [e.steps - p.steps for e, p in pairs]
    alike = sum((e.state, e.found) == (p.state, p.found) for e, p in pairs)
    return (
        f"| {name.partition('-')[0]} | {len(pairs)} | {median(backs_s):.1f} | {max(backs_s):.1f} | {alike} | "
        f"{', '.join(f'{n:+d}' for n in more)} |"
    )


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
