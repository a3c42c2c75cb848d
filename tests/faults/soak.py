"""Plays every kind of fault several times, and prints a table: what became of the searches, and how soon all was back.

    python -m tests.faults.soak --times 5 --state runs/soak/faults.jsonl

With the same ``--state`` a run goes on where it was stopped; what was played stands there, a line each.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from statistics import median

from tests.faults.bring_ups import Leftovers, bring_up
from tests.faults.system import faulty
from tests.faults.table import FAULTS, Played, play, why_not

#: A new system after so many faults, so that one that a fault has broken doesn't spoil the rest.
_FAULTS_A_SYSTEM = 10
BRING_UP = "bring-up and tear-down"


def read(path: Path) -> list[Played]:
    """What was played before."""
    lines = path.read_text().splitlines() if path.exists() else []
    return [Played(**{**row, "wrong": tuple(row["wrong"])}) for row in map(json.loads, lines)]


def append(path: Path, played: Played) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        file.write(json.dumps(asdict(played)) + "\n")
    print(f"{played.fault}: {played.state}, back after {played.recovery_s:.1f} s {played.wrong or ''}", file=sys.stderr)


def table(played: list[Played]) -> str:
    """As Markdown, a line for each kind."""
    lines = [
        "| fault | times | found | ended otherwise | back after, median [s] | longest [s] | search, median [s] | wrong |"
    ]
    lines.append("|---|---:|---:|---|---:|---:|---:|---|")
    for name in dict.fromkeys(p.fault for p in played):
        own = [p for p in played if p.fault == name]
        backs_s, found = [p.recovery_s for p in own], sum(p.found for p in own)
        others = ", ".join(
            f"{n} x {error}" for error, n in Counter(p.error or p.state for p in own if not p.found).items()
        )
        wrong = "; ".join(sorted({what for p in own for what in p.wrong}))
        search_s = median(p.mission_s for p in own)
        times = f"{median(backs_s):.1f} | {max(backs_s):.1f} | {search_s:.0f}"
        lines.append(f"| {name} | {len(own)} | {found} | {others} | {times} | {wrong} |")
    return "\n".join(lines)


def play_faults(path: Path, times: int) -> None:
    """Plays what is missing of every kind."""
    done = Counter(p.fault for p in read(path))
    missing = [fault for number in range(times) for fault in FAULTS if done[fault.name] <= number]
    skipped: dict[str, str] = {}
    while missing:
        batch, missing = missing[:_FAULTS_A_SYSTEM], missing[_FAULTS_A_SYSTEM:]
        with (
            tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder,
            faulty(Path(folder) / "system") as system,
        ):
            for number, fault in enumerate(batch):
                if why := why_not(fault, system):
                    skipped[fault.name] = why
                    continue
                try:
                    append(path, play(fault, system, number))
                except AssertionError as error:
                    words = (str(error).splitlines() or ["it never came"])[0][:200]
                    append(path, Played(fault.name, "lost", False, "", float("nan"), float("nan"), (words,)))
                    missing = [*batch[number + 1 :], *missing]
                    break
    for name, why in skipped.items():
        print(f"not played: {name}: {why}", file=sys.stderr)


def play_bring_ups(path: Path, times: int) -> None:
    """Brings the system up and down what is missing of ``times``, and counts what is left behind."""
    missing = times - sum(p.fault == BRING_UP for p in read(path))
    before: Leftovers | None = None
    for _ in range(missing):
        with tempfile.TemporaryDirectory() as folder:
            took_s = bring_up(Path(folder))
        now = Leftovers.now()
        wrong = now.beyond(before) if before is not None else []
        before = before or now
        append(path, Played(BRING_UP, "done", True, "", 0.0, took_s, tuple(wrong)))


def main() -> int:
    """1 if something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=5, help="how often each kind is played")
    parser.add_argument("--bring-ups", type=int, default=200, help="how often the system is brought up and down")
    parser.add_argument("--state", type=Path, default=Path("runs/soak/faults.jsonl"))
    parser.add_argument("--table", action="store_true", help="only prints the table of what was played")
    arguments = parser.parse_args()
    if not arguments.table:
        play_faults(arguments.state, arguments.times)
        play_bring_ups(arguments.state, arguments.bring_ups)
    played = read(arguments.state)
    print(table(played))
    return int(any(p.wrong for p in played))


if __name__ == "__main__":
    sys.exit(main())
