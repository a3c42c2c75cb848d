"""Each kind of fault happens once, in the midst of a search (`make test-faults`, ten minutes)."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.faults.bring_ups import Leftovers, bring_up
from tests.faults.system import Faulty, faulty
from tests.faults.table import FAULTS, Fault, play, why_not

pytestmark = [pytest.mark.faults, pytest.mark.slow]


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory, home_cache: Path) -> Iterator[Faulty]:
    with pytest.MonkeyPatch.context() as environ:
        environ.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
        with faulty(tmp_path_factory.mktemp("faults")) as running:
            yield running


@pytest.mark.parametrize("fault", [fault for fault in FAULTS if not fault.rare], ids=lambda fault: fault.name)
def test_a_search_survives(fault: Fault, system: Faulty, capsys: pytest.CaptureFixture[str]) -> None:
    if why := why_not(fault, system):
        pytest.skip(why)
    played = play(fault, system)
    with capsys.disabled():
        times = f"back after {played.recovery_s:.1f} s, stood still for {played.standstill_s:.1f} s, all {played.mission_s:.0f} s"
        print(f"\n  {played.state}, {times} ", end="")
    assert not played.wrong, played
    if not (fault.may_fail and played.error == fault.may_fail):
        assert (played.state, played.found) == ("done", True), played


def test_bring_ups_leave_nothing_behind(tmp_path: Path, home_cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
    bring_up(tmp_path / "first")  # what stays for good: libraries, caches
    before = Leftovers.now()
    assert [bring_up(tmp_path / str(number))[1] for number in range(2)] == [[], []]
    assert Leftovers.now().beyond(before) == []
