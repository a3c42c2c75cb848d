"""``surveilnav prepare``: all that a first search needs, made ahead, so that it needs no network and waits for nothing."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console

from surveilnav.cli.progress import bar, counting, downloading
from surveilnav.errors import AssetError
from surveilnav.perception import models
from surveilnav.perception.names import BackendName
from surveilnav.perception.presets import DEFAULT_DETECTORS, DEFAULT_LARGE_DETECTORS, PAPER
from surveilnav.simulator.furniture.assets import PACKAGES, ensure_assets, is_here
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.sources import EXAMPLE_HOMES, PARAMETRIC
from surveilnav.simulator.truth.choose import choose_backend

#: The search that is played so that all loops are compiled: the smallest of the golden run that has cameras.
_SEARCH = "with cameras"
_LOOK_S = 0.5

#: The models that a backend is made of; what comes with the package isn't listed.
_MODELS: dict[str, tuple[str, ...]] = {
    BackendName.ONNX_COCO: tuple(dict.fromkeys((*DEFAULT_DETECTORS, *DEFAULT_LARGE_DETECTORS))),
    BackendName.PAPER: PAPER,
}


@dataclass
class Prepared:
    """What is ready now. ``seconds``: how long each step took."""

    building: str
    floors: list[str]
    cameras: list[str]
    backend: str = ""
    why: str = ""
    notes: list[str] = field(default_factory=list)
    seconds: dict[str, float] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """As ``--json`` says it."""
        return {
            "building": self.building,
            "floors": self.floors,
            "cameras": self.cameras,
            "perception": {"backend": self.backend, "why": self.why},
            "notes": self.notes,
            "seconds": {step: round(seconds, 1) for step, seconds in self.seconds.items()},
        }


def run_prepare(settings: SimulationSettings, perception: str, console: Console, *, loops: bool) -> Prepared:
    """Furniture, then light, camera plan, camera views and navigation, then models, then compiled loops.

    Args:
        perception: whose models are fetched; empty: none.

    Raises:
        SurveilNavError: something can't be had; its text says how to get it.
    """
    seconds: dict[str, float] = {}
    with _timed(seconds, "furniture"):
        _fetch_furniture(settings.building, console)
    with _timed(seconds, "building"), bar(console) as progress:
        building = SimulatedBuilding(settings, progress)
        plan = building.prepare()
    ready = Prepared(plan.building, plan.floors, [camera.name for camera in plan.cameras], notes=list(building.notes))
    if perception:
        with _timed(seconds, "models"):
            ready.backend, ready.why = _fetch_models(perception, settings.seed, console)
    if loops:
        with _timed(seconds, "loops"), counting(console, "loops compiled") as compiled:
            compile_loops(compiled)
    ready.seconds = seconds
    return ready


@contextmanager
def _timed(seconds: dict[str, float], step: str) -> Iterator[None]:
    began_s = time.monotonic()
    yield
    seconds[step] = time.monotonic() - began_s


def _fetch_furniture(building: str, console: Console) -> None:
    """The homes' and furniture's packages. AssetError: an example home needs them, and they can't be had; other buildings
    do with simple shapes, and say so in a note."""
    if is_here() or building in PARAMETRIC:
        return
    try:
        with bar(console) as progress:
            said: list[str] = []

            def say(what: str) -> None:
                """Each package is fetched, then unpacked."""
                progress(len(said) / (2 * len(PACKAGES)), what)
                said.append(what)

            ensure_assets(say)
    except AssetError:
        if building in EXAMPLE_HOMES:
            raise


def _fetch_models(perception: str, seed: int, console: Console) -> tuple[str, str]:
    """(backend, why it was chosen), after its models were fetched and it was loaded once. PerceptionError: it can't be had."""
    for name in _MODELS.get(perception, ()):
        if not models.is_here(name):
            with downloading(console) as on_progress:
                models.pull(name, on_progress=on_progress)
    backend = choose_backend(perception, seed=seed, simulated=True, download=False)
    return backend.name, backend.why


def compile_loops(on_progress: Callable[[int, int, str], None]) -> None:
    """Plays a small search in this process: whatever Numba compiles for it lies in its cache afterwards.

    Args:
        on_progress: is told (compiled, of, which): of all loops, though no search needs every one.
    """
    from surveilnav.benchmark.canary import play, read

    search = next(s for s in read().searches if s.name == _SEARCH)
    ended = threading.Event()
    watching = threading.Thread(target=_tell, args=(ended, on_progress), daemon=True)
    watching.start()
    try:
        play(search)
    finally:
        ended.set()
        watching.join()
    of = len(_loops())
    on_progress(of, of, "")


def _tell(ended: threading.Event, on_progress: Callable[[int, int, str], None]) -> None:
    while not ended.wait(_LOOK_S):
        loops = _loops()
        on_progress(sum(bool(loop.signatures) for loop in loops), max(1, len(loops)), "")


def _loops() -> list[Any]:
    """All functions of ours that Numba compiles, as far as they are loaded."""
    from numba.core.dispatcher import Dispatcher

    ours = [m for name, m in list(sys.modules.items()) if m and name.partition(".")[0] == "surveilnav"]
    return list({id(v): v for m in ours for v in list(vars(m).values()) if isinstance(v, Dispatcher)}.values())
