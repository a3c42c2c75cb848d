"""After their warm-ups fusion and planner compile nothing any more while a robot waits."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterable
from typing import Any

from numba.core.dispatcher import Dispatcher

from benchmark.canary import play, read
from services.fusion.core import FusionConfig
from services.fusion.core.warm_up import warm_up as warm_up_fusion
from services.planner.core import PlannerConfig
from services.planner.core.warm_up import warm_up as warm_up_planner

_SEARCH = "with cameras"


def test_a_search_after_the_warm_ups_compiles_nothing() -> None:
    """In a process of its own: here other tests have compiled whatever they called."""
    new = subprocess.run([sys.executable, "-m", "tests.benchmark.test_warm_up"], capture_output=True, text=True, timeout=300,
                         env=os.environ | {"PYTHONPATH": os.getcwd()}, check=True)  # fmt: skip
    assert json.loads(new.stdout) == {"compiled before": True, "compiled late": []}


def _compiled() -> set[str]:
    """The cores' loops, each with the types that it was compiled for."""
    modules = [m for name, m in list(sys.modules.items()) if name.startswith(("services.fusion", "services.planner"))]
    return {f"{loop.__module__}.{loop.__name__}{s}" for loop in _loops(modules) for s in loop.signatures}


def _loops(modules: Iterable[Any]) -> list[Dispatcher]:
    return [v for module in modules for v in vars(module).values() if isinstance(v, Dispatcher)]


def _main() -> None:
    warm_up_fusion(FusionConfig())
    warm_up_planner(PlannerConfig())
    before = _compiled()
    play(next(search for search in read().searches if search.name == _SEARCH))
    print(json.dumps({"compiled before": bool(before), "compiled late": sorted(_compiled() - before)}))


if __name__ == "__main__":
    _main()
