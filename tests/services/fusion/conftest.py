"""The analytic world of ``tests.world`` as fixtures for fusion's tests."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from tests.world import World, seen, unit


@dataclass(frozen=True)
class Tools:
    """The functions above, for tests: with importmode=importlib a test can't import its neighbours."""

    world: type[World] = World
    unit: object = staticmethod(unit)
    seen: object = staticmethod(seen)


@pytest.fixture(scope="session")
def tools() -> Tools:
    return Tools()


@pytest.fixture
def world() -> World:
    return World()
