"""``surveilnav prepare``: what it makes, and what it does where something can't be had."""

from __future__ import annotations

import json

import pytest
from rich.console import Console
from typer.testing import CliRunner

from surveilnav.cli import preparing
from surveilnav.cli.main import app
from surveilnav.errors import AssetError, PerceptionError
from surveilnav.perception.names import BackendName
from surveilnav.simulator.simulation import SimulationSettings

SMALL = SimulationSettings(building="parametric_flat", cameras=1, lighting="flat")
CONSOLE = Console(stderr=True)


@pytest.fixture
def asked(monkeypatch):
    """The models that are pulled; none can be had."""
    pulled = []

    def pull(name, on_progress):
        pulled.append(name)
        raise PerceptionError(f"no network for {name}")

    monkeypatch.setattr(preparing.models, "is_here", lambda name: False)
    monkeypatch.setattr(preparing.models, "pull", pull)
    return pulled


def test_all_is_ready_and_said_as_json(home_cache, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(home_cache))
    monkeypatch.setenv("SURVEILNAV_SIM__LIGHTING", "flat")
    monkeypatch.setenv("SURVEILNAV_SIM__BUILDING", "parametric_flat")
    monkeypatch.setattr(preparing, "compile_loops", lambda on_progress: on_progress(1, 1, ""))
    run = CliRunner().invoke(app, ["prepare", "--cameras", "1", "--perception", "oracle", "--json"])
    told = json.loads(run.stdout)
    assert (told["building"], told["cameras"], told["perception"]["backend"]) == (
        "parametric_flat-s0",
        ["c0-1"],
        "oracle",
    )
    assert list(told["seconds"]) == ["furniture", "building", "models", "loops"]


@pytest.mark.parametrize(
    ("arguments", "cameras", "area_m2"),
    [
        ([], 7, 50.0),
        (["--building", "studio"], 4, 100.0),
        (["--building", "studio", "--area-per-camera", "80"], None, 80.0),
    ],
)
def test_it_makes_the_plan_that_up_asks_for(monkeypatch, arguments, cameras, area_m2):
    monkeypatch.setenv("SURVEILNAV_SIM__CAMERAS", "7")
    monkeypatch.setenv("SURVEILNAV_SIM__AREA_PER_CAMERA_M2", "50")
    asked = []

    def run_prepare(settings, *_, **__):
        asked.append(settings)
        return preparing.Prepared("b", [], [])

    monkeypatch.setattr(preparing, "run_prepare", run_prepare)
    assert CliRunner().invoke(app, ["prepare", *arguments]).exit_code == 0
    assert (asked[0].cameras, asked[0].area_per_camera_m2) == (cameras, area_m2)


def test_auto_needs_no_download_and_a_name_that_does_is_a_mistake_without(asked, monkeypatch, tmp_path):
    for variable in ("SURVEILNAV_MODELS_DIR", "SURVEILNAV_CACHE_DIR"):
        monkeypatch.setenv(variable, str(tmp_path))
    backend, why = preparing._fetch_models(BackendName.AUTO, 0, CONSOLE)
    assert (backend, "stand in" in why) == ("simulated", True)
    assert asked == []
    with pytest.raises(PerceptionError, match="no network"):
        preparing._fetch_models(BackendName.PAPER, 0, CONSOLE)


def test_without_furniture_only_an_example_home_is_a_mistake(monkeypatch):
    def refuse(say):
        say("downloading")
        raise AssetError("no apt here")

    monkeypatch.setattr(preparing, "is_here", lambda: False)
    monkeypatch.setattr(preparing, "ensure_assets", refuse)
    preparing._fetch_furniture("office_3", CONSOLE)
    preparing._fetch_furniture("parametric_flat", CONSOLE)
    with pytest.raises(AssetError):
        preparing._fetch_furniture("studio", CONSOLE)


def test_loops_are_found_and_their_number_is_told(monkeypatch):
    import surveilnav.benchmark.canary
    from surveilnav.services.planner.core.motion import fast_marching

    monkeypatch.setattr(surveilnav.benchmark.canary, "play", lambda search: None)
    told = []
    preparing.compile_loops(lambda done, of, which: told.append((done, of)))
    assert any(value in preparing._loops() for value in vars(fast_marching).values())
    assert told[-1] == (len(preparing._loops()),) * 2


def test_the_search_that_is_played_exists():
    from surveilnav.benchmark.canary import read

    assert preparing._SEARCH in [search.name for search in read().searches]
