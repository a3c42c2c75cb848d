"""A dataset of two small buildings that need no assets."""

from __future__ import annotations

import shutil
from functools import cache

import pytest

from surveilnav.benchmark.dataset import check
from surveilnav.benchmark.dataset import format as files
from surveilnav.benchmark.dataset.build import open_scene
from surveilnav.benchmark.dataset.make import make
from surveilnav.benchmark.dataset.splits import SceneSpec, SplitSpec, quotas
from surveilnav.benchmark.play.workers import JobResult
from surveilnav.simulator.world.goals import find_goals

SPLIT = SplitSpec(
    "val_mini", (SceneSpec("parametric_flat", 0, "all"), SceneSpec("parametric_house", 1, "all")), 9, (3, 3)
)
QUOTAS = dict(zip(SPLIT.scenes, quotas(SPLIT.episodes, len(SPLIT.scenes)), strict=True))


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


@pytest.fixture(scope="session", autouse=True)
def decoded_once():
    """Most files of a copy hold what the dataset's do, and every check, build and count decodes megabytes of viewpoints."""
    known = {}

    def once(real):
        def asked(path, *kind):
            if not path.is_file():
                return real(path, *kind)
            key = real, kind, path.suffix, path.read_bytes()
            if key not in known:
                if len(known) > 16:
                    known.clear()
                known[key] = real(path, *kind)
            return known[key]

        return asked

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "raw", once(files.raw))
        patch.setattr(files, "read", once(files.read))
        yield


@pytest.fixture
def builds_by_copy(dataset, monkeypatch):
    """A scene of the dataset that is built again is copied from it: for tests of which scenes are built, not of how."""

    def in_workers(work, jobs, workers):
        for job in jobs:
            root, split, spec, n_episodes = job
            assert n_episodes == QUOTAS[spec]
            for folder, end in (("content", ".json.gz"), ("cameras", ".json.gz"), ("scenes", ".json")):
                shutil.copy(dataset / SPLIT.name / folder / f"{spec.scene}{end}", root / split / folder)
            yield JobResult(job, None, "")

    monkeypatch.setattr("surveilnav.benchmark.dataset.make.in_workers", in_workers)
