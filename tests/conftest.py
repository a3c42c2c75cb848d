"""Fixtures for all tests: a router of their own, detector weights, and random numbers from fixed seeds."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import hypothesis
import pytest

from surveilnav.bus import BusSettings, Node
from surveilnav.bus.router import free_port, open_router

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
def models_dir() -> Path:
    """Detector weights; skips where there are none."""
    value = os.environ.get("SURVEILNAV_MODELS_DIR", "")
    if not value or not Path(value).is_dir():
        pytest.skip("SURVEILNAV_MODELS_DIR names no folder with detector weights")
    return Path(value)
