"""Fixtures for all tests: a router of their own, what is made once a run, detector weights, fixed random numbers."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

if "PYTEST_XDIST_WORKER" in os.environ:  # libraries read it when they are loaded; the workers already fill the cores
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import pytest

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.router import free_port, open_router

#: Coverage is measured while these folders' tests run: those of the library, the services and the command line. The others play
#: searches and draw buildings, in which Python's tracer would cost a fifth of the time. They run all the same.
MEASURED = ("cli", "contract", "services", "shared")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """With ``--cov``, has pytest-cov pause for tests whose lines aren't counted."""
    if not config.pluginmanager.hasplugin("_cov"):
        return
    for item in items:
        folder = item.path.relative_to(Path(__file__).parent).parts[0]
        if folder not in MEASURED or item.get_closest_marker("slow"):
            item.add_marker("no_cover")


hypothesis.settings.register_profile("fixed", derandomize=True, deadline=None)
hypothesis.settings.load_profile("fixed")


@pytest.fixture
def bus() -> Iterator[BusSettings]:
    """A real router on a free port, and the settings to reach it."""
    port = free_port()
    with open_router(f"tcp/127.0.0.1:{port}"):
        yield BusSettings(router=f"tcp/127.0.0.1:{port}", building="test", connect_timeout_s=5)


@pytest.fixture
def make_node(bus: BusSettings) -> Iterator[Callable[..., Node]]:
    """``make_node(kind, id)``: nodes on the test's router, closed at its end."""
    with ExitStack() as stack:
        yield lambda kind="test", id="t", **more: stack.enter_context(Node(kind, id, bus, **more))


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that all workers of this run share (pytest-xdist gives each a folder of its own inside)."""
    base = tmp_path_factory.getbasetemp()
    return base.parent if "PYTEST_XDIST_WORKER" in os.environ else base


@pytest.fixture(scope="session")
def made_once(run_folder: Path) -> Callable[[str, Callable[[Path], object]], Path]:
    """``made_once(name, make)``: a folder that ``make(folder)`` filled, once a run. Tests must only read it."""

    def made(name: str, make: Callable[[Path], object]) -> Path:
        folder, done = run_folder / name, run_folder / f"{name}.done"
        with (run_folder / f"{name}.lock").open("w") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX)  # another worker may be making it
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)  # what an attempt that failed left
                folder.mkdir()
                make(folder)
                done.touch()
        return folder

    return made


@pytest.fixture(scope="session")
def home_cache(run_folder: Path) -> Path:
    """A cache folder for the run's small homes: their camera plans and views are made once, not once a test."""
    folder = run_folder / "cache"
    folder.mkdir(exist_ok=True)
    return folder


@pytest.fixture(scope="session")
def models_dir() -> Path:
    """Detector weights; skips where there are none."""
    value = os.environ.get("SURVEILNAV_MODELS_DIR", "")
    if not value or not Path(value).is_dir():
        pytest.skip("SURVEILNAV_MODELS_DIR names no folder with detector weights")
    return Path(value)
