"""Plays every kind of fault several times, and prints a table: what became of the searches, and how soon all was back.

    python -m tests.faults.soak --times 5 --state runs/soak/faults.jsonl

With the same ``--state`` a run goes on where it was stopped; what was played stands there, a line each.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from statistics import median

import httpx

from surveilnav.errors import SurveilNavError
from tests.faults.bring_ups import Leftovers, bring_up
from tests.faults.system import faulty
from tests.faults.table import FAULTS, Fault, Played, play, why_not

#: A new system after so many faults, so that one that a fault has broken doesn't spoil the rest.
_FAULTS_A_SYSTEM = 10
BRING_UP = "bring-up and tear-down"
#: The state of a search that wasn't seen to end.
LOST = "lost"


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
        "| fault | times | found | ended otherwise | back after [s] | longest | stood still [s] | longest | search [s] | wrong |",
        "|---|---:|---:|---|---:|---:|---:|---:|---:|---|",
    ]
    for name in dict.fromkeys(p.fault for p in played):
        own = [p for p in played if p.fault == name]
        others = ", ".join(
            f"{n} x {error}" for error, n in Counter(p.error or p.state for p in own if not p.found).items()
        )
        wrong = "; ".join(f"{n} x {what}" for what, n in Counter(what for p in own for what in p.wrong).items())
        ended = [p for p in own if p.state != LOST]
        backs_s, stills_s = [p.recovery_s for p in ended], [p.standstill_s for p in ended]
        times = [median(backs_s), max(backs_s), median(stills_s), max(stills_s)] if ended else [float("nan")] * 4
        search_s = median(p.mission_s for p in ended) if ended else float("nan")
        row = [
            name,
            len(own),
            sum(p.found for p in own),
            others,
            *(f"{t:.1f}" for t in times),
            f"{search_s:.0f}",
            wrong,
        ]
        lines.append(f"| {' | '.join(map(str, row))} |")
    return "\n".join(lines)


def play_faults(path: Path, times: int, words: list[str]) -> None:
    """Plays what is missing of every kind whose name holds one of the words; of all without any."""
    kinds = [fault for fault in FAULTS if not words or any(word in fault.name for word in words)]
    done = Counter(p.fault for p in read(path))
    missing = [fault for number in range(times) for fault in kinds if done[fault.name] <= number]
    skipped: dict[str, str] = {}
    while missing:
        batch = missing[:_FAULTS_A_SYSTEM]
        with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
            n_tried = _play_batch(path, Path(folder) / "system", batch, skipped)
        missing = missing[n_tried:]
    for name, why in skipped.items():
        print(f"not played: {name}: {why}", file=sys.stderr)


def _play_batch(path: Path, folder: Path, batch: list[Fault], skipped: dict[str, str]) -> int:
    """Plays faults in one system, until one has broken it; returns how many were tried, at least one."""
    n_tried = 0
    try:
        with faulty(folder) as system:
            for fault in batch:
                n_tried += 1
                if why := why_not(fault, system):
                    skipped[fault.name] = why
                else:
                    append(path, play(fault, system))
    except (AssertionError, httpx.HTTPError) as error:
        n_tried = max(n_tried, 1)
        fault = batch[n_tried - 1]
        kept = path.parent / f"lost-{int(time.time())}"
        shutil.copytree(folder, kept, ignore=shutil.ignore_patterns("state", "wrappers"), ignore_dangling_symlinks=True)
        words = (str(error).splitlines() or ["it never came"])[0][:200]
        append(path, Played(fault.name, LOST, False, "", float("nan"), float("nan"), (words,)))
        print(f"the logs are in {kept}", file=sys.stderr)
    return n_tried


def play_bring_ups(path: Path, times: int) -> None:
    """Brings the system up and down what is missing of ``times``, and counts what is left behind."""
    missing = times - sum(p.fault == BRING_UP for p in read(path))
    before: Leftovers | None = None
    for _ in range(missing):
        with tempfile.TemporaryDirectory() as folder:
            try:
                took_s, left = bring_up(Path(folder))
                state = "done"
            except SurveilNavError as error:
                took_s, left, state = float("nan"), [str(error)[:200]], LOST
        now = Leftovers.now()
        left += now.beyond(before) if before is not None else []
        before = before or now  # of the first one, libraries and caches stay for good
        append(path, Played(BRING_UP, state, state == "done", "", 0.0, took_s, tuple(left)))


def main() -> int:
    """1 if something was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=5, help="how often each kind is played")
    parser.add_argument("--bring-ups", type=int, default=200, help="how often the system is brought up and down")
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="WORD", help="only kinds whose name holds one of these"
    )
    parser.add_argument("--state", type=Path, default=Path("runs/soak/faults.jsonl"))
    parser.add_argument("--table", action="store_true", help="only prints the table of what was played")
    arguments = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # by which the running system is stopped, too
    if not arguments.table:
        play_faults(arguments.state, arguments.times, arguments.only)
        play_bring_ups(arguments.state, arguments.bring_ups)
    played = read(arguments.state)
    print(table(played))
    return int(any(p.wrong for p in played))


if __name__ == "__main__":
    sys.exit(main())
