"""The furniture of the training half and of the validation half: no target is made of both."""

from __future__ import annotations

from pathlib import Path

import pytest

from surveilnav.simulator.plans.placing import Models, kinds, split_kind_of
from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
from surveilnav.simulator.sources import EXAMPLE_HOMES, open_building
from surveilnav.simulator.world.labels import TARGETS


def for_half(half: Models) -> set[str]:
    """The models that targets may be made of in a half."""
    return {m for kind in kinds().values() if kind.label in TARGETS for m in kind.for_half(half)}


def test_every_target_kind_has_models_in_both_halves() -> None:
    for kind in kinds().values():
        assert kind.val <= set(kind.models)
        if kind.label in TARGETS:
            assert kind.val
            assert set(kind.models) - kind.val
            assert (
                set(kind.for_half("train")) | set(kind.for_half("val")) == set(kind.models) == set(kind.for_half("all"))
            )


def test_the_halves_share_no_model_even_across_kinds() -> None:
    assert not for_half("train") & for_half("val")
    for name in ("toilet", "tv"):
        assert len(kinds()[name].for_half("train")) == len(kinds()[name].for_half("val")) == 2


def test_pieces_that_stay_have_a_kind_for_the_halves() -> None:
    for label in TARGETS:
        kind = split_kind_of("somebody's own", label)
        assert kind is not None
        assert kind.label == label
    assert split_kind_of("x", "dining table") is None


def test_a_half_is_a_plan_of_its_own(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    paths = {SimulatedBuilding(SimulationSettings(models=m))._plan_path() for m in ("all", "train", "val")}
    assert len(paths) == 3


@pytest.mark.assets
@pytest.mark.usefixtures("assets")
@pytest.mark.parametrize("home", EXAMPLE_HOMES)
def test_homes_keep_to_their_half(home: str) -> None:
    counts = []
    for half in ("train", "val"):
        scene = open_building(home, models=half)
        used = {i.model for i in scene.instances if i.label in TARGETS}
        assert used
        assert used <= for_half(half)
        counts.append([(i.label, i.floor) for i in scene.instances if i.label in TARGETS])
    assert counts[0] == counts[1]


@pytest.mark.assets
@pytest.mark.usefixtures("assets")
def test_with_all_models_homes_are_what_they_were() -> None:
    """The hashes are those of dataset v2. Halves of the furniture left v1's as they were."""
    assert open_building("studio").content_hash == "b92e52642c8548d77a314f56b753d81506b77cc8"
    assert open_building("2_bedroom_basement", seed=3).content_hash == "26bd34faa1014b1d407b7a10d6ee28bf06a9a159"
