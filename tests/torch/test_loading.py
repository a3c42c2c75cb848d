"""Folders that are whole, half, or another model's; parts by their models' names; the preset ``paper``."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole
from surveilnav.perception import parts
from surveilnav.perception.backend import ViewTask
from surveilnav.perception.detectors.grounding_dino import GroundingDino
from surveilnav.perception.embedders.clip import Clip
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.torch_model import TorchModel, find_device
from surveilnav.simulator.truth.choose import choose_backend

CAMERA = Pinhole.from_hfov(160, 120, 1.3)


@pytest.fixture
def copied(folder_of: Callable[..., Path], tmp_path: Path) -> Path:
    """A Grounding DINO that a test may spoil."""
    return Path(shutil.copytree(folder_of("grounding_dino"), tmp_path / "spoilt"))


@pytest.mark.parametrize(
    ("file", "message"),
    [
        ("config.json", r"config.json can't be read"),
        ("model.safetensors", r"can't be loaded as AutoModelForZeroShot"),
        ("preprocessor_config.json", r"no ImageProcessor that can be read"),
        ("tokenizer.json", r"has no tokenizer: expected"),
    ],
)
def test_half_a_folder_is_refused_by_name(copied: Path, file: str, message: str) -> None:
    (copied / file).unlink()
    with pytest.raises(PerceptionError, match=f"spoilt.*{message}.*Fetch the folder anew|spoilt.{message}"):
        GroundingDino(copied, "half")


def test_weights_that_are_cut_off_are_refused(copied: Path) -> None:
    weights = copied / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:5000])
    with pytest.raises(PerceptionError, match=r"spoilt can't be loaded"):
        GroundingDino(copied, "cut")


def test_a_model_that_lacks_weights_is_not_run_with_random_ones(copied: Path) -> None:
    weights = load_file(copied / "model.safetensors")
    lacking = {name: tensor for name, tensor in weights.items() if "text_projection" not in name}
    save_file(lacking, copied / "model.safetensors", metadata={"format": "pt"})
    with pytest.raises(PerceptionError, match=r"lacks 2 weights .*text_projection"):
        GroundingDino(copied, "lacking")


def test_another_models_folder_is_refused(folder_of: Callable[..., Path], copied: Path) -> None:
    with pytest.raises(PerceptionError, match=r"expected a model of type grounding-dino or .*holds 'clip'"):
        GroundingDino(folder_of("clip"), "wrong")
    with pytest.raises(PerceptionError, match=r"expected a detector of grounding-dino, .* is 'clip'"):
        parts.load_detector(str(folder_of("clip")), Runtime())
    with pytest.raises(PerceptionError, match=r"expected an embedder of clip, .* is 'grounding-dino'"):
        parts.load_embedder(str(copied), Runtime())
    (copied / "config.json").write_text("[]")
    with pytest.raises(PerceptionError, match=r"config.json should be a model's settings"):
        parts.load_detector(str(copied), Runtime())


def test_an_unknown_name_is_refused_with_the_known_ones(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(tmp_path))
    with pytest.raises(PerceptionError, match=r"expected a model out of .*, or the path of a folder; got 'nobody'"):
        parts.load_detector("nobody", Runtime(), download=False)


def test_without_torch_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch, folder_of: Callable[..., Path]) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    for module in [name for name in sys.modules if name.startswith(("surveilnav.perception.embedders.clip", "surveilnav.perception.torch_model"))]:  # fmt: skip  # noqa: E501
        monkeypatch.delitem(sys.modules, module)
    with pytest.raises(PerceptionError, match=r"needs PyTorch .*pip install 'surveilnav\[perception-torch\]'"):
        parts.load_embedder(str(folder_of("clip")), Runtime())


def test_a_device_that_is_not_there_is_refused() -> None:
    assert find_device("cpu") == torch.device("cpu")
    assert find_device("auto").type in ("cpu", "cuda")
    for name in ("abacus", "cuda:99"):
        with pytest.raises(PerceptionError, match=f"expected a device out of auto, cpu, .*'{name}' can't be used"):
            find_device(name)


def test_nothing_is_recorded_for_training() -> None:
    net = torch.nn.Linear(2, 2)
    with TorchModel(net, torch.device("cpu")).running():
        assert not net(torch.zeros(1, 2)).requires_grad


def test_other_weights_have_another_id(folder_of: Callable[..., Path], copied: Path) -> None:
    before = parts.load_detector(str(copied), Runtime()).model
    assert before.startswith("spoilt@")
    assert before == parts.load_detector(str(copied), Runtime()).model
    weights = load_file(copied / "model.safetensors")
    weights["model.text_projection.bias"] += 1
    save_file(weights, copied / "model.safetensors", metadata={"format": "pt"})
    assert parts.load_detector(str(copied), Runtime()).model != before


def test_paper_runs_from_folders_in_the_models_directory(
    folder_of: Callable[..., Path], pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name, made in (
        ("my-dino", "grounding_dino"),
        ("mobile-sam", "mobile_sam_onnx"),
        ("my-clip", "clip"),
    ):
        shutil.copytree(folder_of(made), tmp_path / name)
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(tmp_path))
    backend = choose_backend("paper", detector="my-dino", embedder="my-clip", threshold=0.2)
    assert backend.why == "any word (my-dino + mobile-sam + my-clip), asked for by name"
    assert backend.vocabulary is None
    assert backend.models.embedder.startswith("my-clip@")
    depth_m = np.full((120, 160), 2.0, np.float32)
    task = [ViewTask(RgbdView(rgb, depth_m, CAMERA), ("couch", "fire extinguisher")) for rgb in pictures[:3]]
    for stage in backend.stages:
        stage.run(task)
    for one in task:
        assert one.result is not None
        assert one.result.detections
        assert {d.label for d in one.result.detections} <= {"couch", "fire extinguisher"}
        alone = backend.perceive(one.view.rgb, depth_m, CAMERA, prompts=one.prompts)
        np.testing.assert_allclose(alone.image_embedding, one.result.image_embedding, atol=1e-5)
    assert backend.perceive(pictures[0], depth_m, CAMERA).detections == ()


def test_each_part_of_paper_can_be_another(folder_of: Callable[..., Path], pictures: list[np.ndarray]) -> None:
    backend = choose_backend(
        "paper", detector=str(folder_of("owlv2")), segmenter="depth-in-box", embedder=str(folder_of("siglip"))
    )
    ids = (backend.models.detector, backend.models.segmenter, backend.models.embedder)
    assert [i.split("@")[0][:4] for i in ids] == ["owlv", "dept", "sigl"]
    seen = backend.perceive(pictures[0], np.full((120, 160), 2.0, np.float32), CAMERA, prompts=("couch",))
    assert seen.image_embedding.shape == (32,)


def test_clip_reads_weights_of_the_older_format(folder_of: Callable[..., Path], tmp_path: Path) -> None:
    """OpenAI's folder has a pickle; of a pickle nothing but tensors is read."""
    folder = Path(shutil.copytree(folder_of("clip"), tmp_path / "pickled"))
    weights: dict[str, Any] = load_file(folder / "model.safetensors")
    (folder / "model.safetensors").unlink()
    torch.save(weights, folder / "pytorch_model.bin")
    expected = Clip(folder_of("clip"), "a").embed_texts(["a bed"])
    np.testing.assert_allclose(Clip(folder, "b").embed_texts(["a bed"]), expected, atol=1e-6)
    assert json.loads((folder / "config.json").read_bytes())["model_type"] == "clip"
