"""After their warm-ups fusion and planner compile nothing any more while a robot waits."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

from surveilnav.benchmark.canary import play, read
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.fusion.core.warm_up import warm_up as warm_up_fusion
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.services.planner.core.warm_up import warm_up as warm_up_planner

#: Of the golden run, by the maps' preset.
_SEARCHES = {"ours": "with cameras", "paper": "by the letter of the paper"}


@pytest.mark.parametrize("preset", _SEARCHES)
def test_a_search_after_the_warm_ups_compiles_nothing(preset: str) -> None:
    """In a process of its own: here other tests have compiled whatever they called."""
    new = subprocess.run(
        [sys.executable, "-m", "tests.benchmark.test_warm_up", preset],
        capture_output=True,
        text=True,
        timeout=200,
        env=os.environ | {"PYTHONPATH": os.getcwd()},
    )
    assert new.returncode == 0, new.stderr
    assert json.loads(new.stdout) == {"compiled before": True, "compiled late": []}


@pytest.mark.parametrize(
    "changes",
    [
        {"map": {"extent_m": 2.0, "max_extent_m": 6.0}},
        {"map": {"resolution_m": 0.2}},
        {"map": {"voxel_m": 0.2}},
        {"map": {"carve_views": 0}},
        {"objects": {"confirmation": {"rule": "paper"}}},
    ],
)
def test_fusion_warms_up_whatever_is_set(changes: dict[str, Any]) -> None:
    warm_up_fusion(FusionConfig().changed(changes))


@pytest.mark.parametrize("changes", [{"strategy": "greedy"}, {"promising_chance": None}, {"scan_turns": 0}])
def test_the_planner_warms_up_whatever_is_set(changes: dict[str, Any]) -> None:
    warm_up_planner(PlannerConfig().changed(**changes))


def _compiled() -> set[str]:
    """The cores' loops, each with the types that it was compiled for."""
    modules = [
        m
        for name, m in list(sys.modules.items())
        if name.startswith(("surveilnav.services.fusion", "surveilnav.services.planner"))
    ]
    return {f"{loop.__module__}.{loop.__name__}{s}" for loop in _loops(modules) for s in loop.signatures}


def _loops(modules: Iterable[Any]) -> list[Dispatcher]:
    return [v for module in modules for v in vars(module).values() if isinstance(v, Dispatcher)]


def _main(preset: str) -> None:
    warm_up_fusion(FusionConfig() if preset == "ours" else FusionConfig.preset(preset))
    warm_up_planner(PlannerConfig())
    before = _compiled()
    play(next(search for search in read().searches if search.name == _SEARCHES[preset]))
    print(json.dumps({"compiled before": bool(before), "compiled late": sorted(_compiled() - before)}))


if __name__ == "__main__":
    _main(sys.argv[1])
