"""Plays inputs that pass the check of their schema into every decoder and file reader, and into the code behind it.

    python -m tests.fuzz.decoders --inputs 1000000 --seed 1 --state runs/fuzz/decoders.json

Each input is made from the seed and its number alone (``--only NUMBER`` plays one again). What must hold: no exception but the
documented ones, no input takes more than a second of the processor, memory doesn't grow, and nothing that was refused is in
the maps. With ``--state`` the run goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import gc
import json
import sys
import time
import traceback
from collections import Counter
from dataclasses import asdict, dataclass, field
from itertools import accumulate
from pathlib import Path
from random import Random

from surveilnav.storage import atomic_write
from tests.fuzz.target import Target
from tests.fuzz.values import Values

#: Processing one input may take so long, in CPU time: what hostile senders could make a service wait for.
SLOW_S = 1.0
_CHECK_EVERY, _SAVE_EVERY = 5_000, 10_000
#: Inputs before memory is first measured: until then pictures are loaded, and caches fill.
_WARM_UP = 20_000


@dataclass
class Defect:
    """Inputs for which something didn't hold: the first one's number, what happened, and how many there were."""

    target: str
    number: int
    what: str
    count: int = 1


@dataclass
class Tally:
    """The result so far. ``memory_mb``: by input number, the resident memory of this process."""

    seed: int
    done: int = 0
    seconds: float = 0.0
    outcomes: dict[str, Counter[str]] = field(default_factory=dict)
    slowest_s: dict[str, float] = field(default_factory=dict)
    defects: dict[str, Defect] = field(default_factory=dict)
    memory_mb: dict[int, float] = field(default_factory=dict)

    @property
    def passed(self) -> int:
        """How many inputs passed their schema."""
        return sum(n for counts in self.outcomes.values() for outcome, n in counts.items() if outcome != "stopped")

    def record(self, target: str, outcome: str, took_s: float) -> None:
        self.outcomes.setdefault(target, Counter())[outcome] += 1
        self.slowest_s[target] = max(took_s, self.slowest_s.get(target, 0.0))

    def record_defect(self, target: str, number: int, where: str, what: str) -> None:
        if known := self.defects.get(f"{target} {where}"):
            known.count += 1
        else:
            self.defects[f"{target} {where}"] = Defect(target, number, what)

    def growth_mb(self) -> float:
        """How much more memory the last tenth took than the first after the warm-up, by medians; 0 if there are too few."""
        measured = [mb for number, mb in sorted(self.memory_mb.items()) if number >= _WARM_UP]
        n = max(1, len(measured) // 10)
        if len(measured) < 10:
            return 0.0
        return sorted(measured[-n:])[n // 2] - sorted(measured[:n])[n // 2]

    def table(self) -> str:
        """As Markdown."""
        lines = ["| decoder or reader | inputs | stopped at the schema | refused behind it | taken | slowest [ms] |"]
        lines.append("|---|---:|---:|---:|---:|---:|")
        for name, counts in sorted(self.outcomes.items()):
            cells = [sum(counts.values()), counts["stopped"], counts["refused"], counts["taken"]]
            slowest_ms = 1000 * self.slowest_s[name]
            lines.append(f"| {name} | {' | '.join(f'{n:,}' for n in cells)} | {slowest_ms:.0f} |")
        return "\n".join(lines)


class Fuzzer:
    """Plays numbered inputs."""

    def __init__(self, targets: list[Target], seed: int, tally: Tally | None = None, slow_s: float = SLOW_S) -> None:
        self.targets, self.tally, self._slow_s = targets, tally or Tally(seed), slow_s
        self._shares = list(accumulate(target.share for target in targets))

    def play(self, number: int) -> None:
        """Makes an input from its number, and has it processed."""
        random = Random(self.tally.seed << 40 | number)
        target = random.choices(self.targets, cum_weights=self._shares)[0]
        began_s = time.thread_time()  # other processes don't count; what a hypervisor takes from this CPU does
        try:
            outcome = target.play(Values(random))
        except Exception as error:
            outcome = "defect"
            frame = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{type(error).__name__} {Path(frame.filename).name}:{frame.name}"
            self.tally.record_defect(target.name, number, where, traceback.format_exc(limit=-6))
        took_s = time.thread_time() - began_s
        self.tally.record(target.name, outcome, took_s)
        if took_s > self._slow_s:
            self.tally.record_defect(target.name, number, "slow", f"it took {took_s:.1f} s")

    def check(self) -> None:
        """Checks what targets keep, and measures memory."""
        for target in self.targets:
            try:
                target.check()
            except AssertionError:
                self.tally.record_defect(target.name, self.tally.done, "kept", traceback.format_exc(limit=-3))
        gc.collect()
        _return_freed_memory()
        self.tally.memory_mb[self.tally.done] = resident_mb()

    def run(self, until: int, say: object = None) -> None:
        """Plays inputs until so many passed their schema."""
        self.tally.memory_mb = {}  # of another process, if there are any
        while self.tally.passed < until:
            began_s = time.monotonic()
            for number in range(self.tally.done, self.tally.done + 500):
                self.play(number)
            self.tally.done += 500
            self.tally.seconds += time.monotonic() - began_s
            if self.tally.done % _CHECK_EVERY == 0:
                self.check()
            if self.tally.done % _SAVE_EVERY == 0 and callable(say):
                say()


def _return_freed_memory() -> None:
    """Has glibc give back what was freed, so that what its heap keeps for later isn't taken for growth."""
    with contextlib.suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL("libc.so.6").malloc_trim(0)


def resident_mb() -> float:
    """The memory of this process."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * 4096 / 2**20


def load(path: Path, seed: int) -> Tally:
    """The tally of a run that was stopped; a new one if there is none with this seed."""
    if not path.exists():
        return Tally(seed)
    plain = json.loads(path.read_text())
    if plain["seed"] != seed:
        return Tally(seed)
    plain["outcomes"] = {name: Counter(counts) for name, counts in plain["outcomes"].items()}
    plain["defects"] = {key: Defect(**defect) for key, defect in plain["defects"].items()}
    plain["memory_mb"] = {int(number): mb for number, mb in plain["memory_mb"].items()}
    return Tally(**plain)


def save(path: Path, tally: Tally) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    with atomic_write(path) as file:
        defects = {key: asdict(defect) for key, defect in tally.defects.items()}
        file.write(json.dumps({**vars(tally), "defects": defects}, indent=1).encode())


def main() -> int:
    """Plays the inputs; 1 if a defect was found."""
    from tests.fuzz.targets import all_targets

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--inputs", type=int, default=20_000, help="how many inputs are to pass their schema")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--state", type=Path, help="the file that keeps what was played")
    parser.add_argument("--only", type=int, help="plays the input of this number alone, and prints its traceback")
    parser.add_argument("--target", default="", help="plays only targets whose name begins so")
    arguments = parser.parse_args()
    targets = [target for target in all_targets() if target.name.startswith(arguments.target)]
    tally = load(arguments.state, arguments.seed) if arguments.state else Tally(arguments.seed)
    fuzzer = Fuzzer(targets, arguments.seed, tally)
    if arguments.only is not None:
        fuzzer.play(arguments.only)
    else:
        fuzzer.run(arguments.inputs, lambda: _progress(tally, arguments.state))
        if arguments.state:
            save(arguments.state, tally)
        print(tally.table())
        rate = tally.passed / max(tally.seconds, 1e-9)
        print(f"\n{tally.passed:,} inputs passed their schema, of {tally.done:,}; {rate:,.0f} a second; ", end="")
        print(f"memory of the last tenth over that of the first: {tally.growth_mb():+.1f} MB")
    for defect in tally.defects.values():
        print(f"\nDEFECT {defect.target}, input {defect.number}, {defect.count} times\n{defect.what}")
    return 1 if tally.defects else 0


def _progress(tally: Tally, state: Path | None) -> None:
    if state:
        save(state, tally)
    rate = tally.passed / max(tally.seconds, 1e-9)
    memory_mb = list(tally.memory_mb.values())[-1:]
    print(
        f"{tally.passed:,} passed, {rate:,.0f} a second, {len(tally.defects)} defects, {memory_mb} MB", file=sys.stderr
    )


if __name__ == "__main__":
    sys.exit(main())
