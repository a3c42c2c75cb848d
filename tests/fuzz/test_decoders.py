"""A few thousand of the fuzzer's inputs, always the same ones; `python -m tests.fuzz.decoders` plays more."""

from __future__ import annotations

from pathlib import Path

import pytest

from surveilnav.errors import SurveilNavError, WireError
from tests.fuzz.decoders import Fuzzer, Tally, load, save
from tests.fuzz.target import Target
from tests.fuzz.targets import all_targets
from tests.fuzz.values import Values

INPUTS = 6_000


@pytest.mark.slow
def test_nothing_that_passes_its_schema_breaks_the_code_behind_it() -> None:
    # Beside a whole suite on a shared CPU, time says little: here, only what never ends is a defect.
    fuzzer = Fuzzer(all_targets(), seed=48, slow_s=30.0)
    fuzzer.run(INPUTS)
    tally = fuzzer.tally
    found = [f"{defect.target}, input {defect.number}: {defect.what}" for defect in tally.defects.values()]
    assert not found, "\n".join(found)
    for target in fuzzer.targets:
        outcomes = tally.outcomes[target.name]
        assert outcomes["taken"] + outcomes["refused"] > 10, f"{target.name}: {outcomes}"


class _Broken(Target):
    """Code that fails for some inputs, as each of the others must not."""

    name = "broken"

    def input(self, values: Values) -> int:
        number = values.random.randrange(10)
        if number == 0:
            raise WireError("no number")
        return number

    def process(self, data: object, values: Values) -> bool:
        if data == 1:
            raise ZeroDivisionError
        if data == 2:
            raise SurveilNavError("as documented")
        return data != 3

    def check(self) -> None:
        raise AssertionError("something was left behind")


def test_the_fuzzer_finds_what_is_broken_and_can_play_it_again() -> None:
    fuzzer = Fuzzer([_Broken()], seed=1)
    fuzzer.run(400)
    fuzzer.check()
    outcomes, defects = fuzzer.tally.outcomes["broken"], fuzzer.tally.defects
    assert all(outcomes[name] > 10 for name in ("stopped", "refused", "taken", "defect"))
    assert {defect.what.strip().splitlines()[-1] for defect in defects.values()} == {
        "ZeroDivisionError",
        "AssertionError: something was left behind",
    }
    (number,) = (d.number for d in defects.values() if "Zero" in d.what)
    again = Fuzzer([_Broken()], seed=1)
    again.play(number)
    assert again.tally.outcomes["broken"] == {"defect": 1}


def test_a_run_that_was_stopped_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    fuzzer = Fuzzer([_Broken()], seed=1)
    fuzzer.run(400)
    save(path, fuzzer.tally)
    assert load(path, 1) == fuzzer.tally
    assert load(path, 2) == Tally(2)
    assert load(tmp_path / "none.json", 1) == Tally(1)


def test_memory_that_grows_is_seen() -> None:
    steady, growing = Tally(1), Tally(1)
    for number in range(0, 1_000_000, 5_000):
        steady.memory_mb[number], growing.memory_mb[number] = 300.0 + number % 7, 300.0 + number / 10_000
    assert abs(steady.growth_mb()) < 7 < 50 < growing.growth_mb()
