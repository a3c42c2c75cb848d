"""What names a camera's view between runs names all that it depends on."""

from __future__ import annotations

import pytest

from surveilnav.simulator import simulation
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings


@pytest.fixture(autouse=True)
def cache(home_cache, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))


def content(view: int = 0, **changes: object) -> str:
    facts = {"building": "parametric_flat", "cameras": 1, "lighting": "flat"} | changes
    building = SimulatedBuilding(SimulationSettings(**facts))
    return building.camera_content(building.plan.cameras[0], view)


def test_the_same_view_has_the_same_name_in_every_run():
    assert content() == content()


@pytest.mark.parametrize("changes", [{"view": 1}, {"seed": 1}, {"depth_noise": False}, {"lighting": "shadowed"}])
def test_another_view_has_another_name(changes):
    assert content(**changes) != content()


def test_another_renderer_makes_another_view(monkeypatch):
    first = content()
    monkeypatch.setattr(simulation, "code_fingerprint", lambda *names: "another")
    assert content() != first


def test_another_range_makes_another_view(monkeypatch):
    first = content()
    monkeypatch.setattr(simulation, "CAMERA_DEPTH_RANGE_M", (0.3, 5.0))
    assert content() != first
