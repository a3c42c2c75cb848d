"""The catalogue's entries can be what they say."""

from __future__ import annotations

import re

import pytest

from surveilnav.perception import models
from surveilnav.perception.presets import DEFAULT_DETECTORS, DEFAULT_LARGE_DETECTORS


@pytest.mark.parametrize("model", models.CATALOGUE.values(), ids=lambda model: model.name)
def test_an_entry_is_whole(model):
    assert model.licence
    assert model.note
    assert model.confirmed
    assert (bool(model.repo), bool(model.url), bool(model.setting)).count(True) == 1
    assert bool(model.repo) == bool(model.revision)
    for file in model.files:
        assert file.sha256 is None or re.fullmatch(r"[0-9a-f]{64}", file.sha256)
    if model.url:
        assert model.url.startswith("https://")
        assert model.url.endswith(model.files[0].name)
        assert model.files[0].sha256, "no lock vouches for an address without a commit"
    if model.repo:
        assert model.is_folder
        assert any(file.name in ("model.safetensors", "pytorch_model.bin") for file in model.files)
        assert model.size_bytes


def test_no_two_models_lie_in_the_same_place():
    paths = [model.path for model in models.CATALOGUE.values()]
    assert len(set(paths)) == len(paths)


def test_the_closed_set_is_what_the_backend_runs():
    assert set(DEFAULT_DETECTORS) | set(DEFAULT_LARGE_DETECTORS) <= set(models.COCO_DETECTORS)
    assert {models.family(name) for name in models.COCO_DETECTORS} == {"yolox", "deimv2", "picodet"}
    assert all(models.CATALOGUE[name].licence.startswith("Apache-2.0") for name in models.COCO_DETECTORS)


def test_what_has_its_classes_in_its_file_can_be_another_file():
    custom = {name for name, model in models.CATALOGUE.items() if model.setting}
    assert custom == {"yolo-world", "compact"}
    assert {name for name, model in models.CATALOGUE.items() if model.vocabulary == "own"} == custom
    assert {name for name, model in models.CATALOGUE.items() if model.built_in} == {"compact"}


def test_addresses_go_through_the_endpoint_and_name_the_revision():
    model = models.model_called("owlv2-base")
    address = model.address(model.files[0], model.revision, "https://mirror.org")
    repository, revision = "google/owlv2-base-patch16-ensemble", "cfd3195ba4ea9592eec887ded089f4c08eff231d"
    assert address == f"https://mirror.org/{repository}/resolve/{revision}/config.json"
