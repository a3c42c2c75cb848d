"""Python imports this when it starts with this folder in PYTHONPATH: from then on the simulator can't be imported."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from types import ModuleType


class _Refusal:
    """An import hook, see ``importlib.abc.MetaPathFinder``."""

    def find_spec(self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> None:
        if name == "surveilnav.simulator" or name.startswith("surveilnav.simulator."):
            raise ImportError(f"{name}: the simulator isn't part of a real building")


sys.meta_path.insert(0, _Refusal())  # type: ignore[arg-type]
