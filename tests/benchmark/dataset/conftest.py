"""A dataset of two small buildings that need no assets."""

from __future__ import annotations

from functools import cache

import pytest

from benchmark.dataset import check
from benchmark.dataset.build import open_scene
from benchmark.dataset.make import make
from benchmark.dataset.splits import SceneSpec, SplitSpec
from simulator.world.goals import find_goals

SPLIT = SplitSpec(
    "val_mini", (SceneSpec("parametric_flat", 0, "all"), SceneSpec("parametric_house", 1, "all")), 9, (3, 3)
)


@pytest.fixture(scope="session")
def dataset(made_once):
    return made_once("dataset", lambda root: make(root, [SPLIT], workers=1))


@pytest.fixture(scope="session", autouse=True)
def opened_once():
    """Deep checks ask the same two buildings again and again, and buildings don't change."""

    @cache
    def opened(building, seed, models, lighting):
        return open_scene(SceneSpec(building, seed, models), lighting=lighting)

    @cache
    def goals(building, label):
        return find_goals(building.scene, building.navigation, label, caster=building.caster)

    buildings = {}

    def open_one(record, lighting):
        building = opened(record.building, record.seed, record.models, lighting)
        buildings[id(building.scene)] = building
        return building

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(check, "open_scene", open_one)
        patch.setattr(check, "find_goals", lambda scene, navigation, label, caster: goals(buildings[id(scene)], label))
        yield
