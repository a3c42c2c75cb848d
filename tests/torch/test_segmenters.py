"""SAM 2 and MobileSAM: batches, what the network is fed, masks in their boxes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import onnx
import pytest
import torch

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.segmenters.mobile_sam import MobileSam, OnnxNetwork, pad_to_square
from surveilnav.perception.segmenters.sam2 import Sam2
from surveilnav.sensing.views import box_cells
from tests.torch import literal, tiny

#: Fractions of pixels, the picture's edges and beyond, a sliver.
BOXES = np.array([[10.4, 10.6, 60.2, 50.9], [0, 0, 160, 120], [-5, 60, 30, 140], [100, 5, 101.5, 115]], np.float32)
KINDS: dict[str, tuple[Any, str]] = {"sam2": (Sam2, "sam2"), "mobile-sam": (MobileSam, "mobile_sam_onnx")}


@pytest.fixture(params=KINDS)
def segmenter(request: pytest.FixtureRequest, folder_of: Callable[..., Path]) -> Any:
    kind, name = KINDS[request.param]
    return kind(folder_of(name), request.param)


def view(rgb: np.ndarray) -> RgbdView:
    height, width = rgb.shape[:2]
    return RgbdView(rgb, np.ones((height, width), np.float32), Pinhole.from_hfov(width, height, 1.3))


def test_masks_are_of_their_boxes_cells(segmenter: Any, pictures: list[np.ndarray]) -> None:
    (masks,) = segmenter.segment([view(pictures[0])], [BOXES])
    for mask, box in zip(masks, BOXES.tolist(), strict=True):
        x0, y0, x1, y1 = box_cells(tuple(box), 160, 120)
        assert mask is None or (mask.shape == (y1 - y0, x1 - x0) and mask.dtype == bool and mask.any())
    assert any(mask is not None and not mask.all() for mask in masks)  # it does cut something out


def test_eight_at_once_are_eight_one_by_one(segmenter: Any, pictures: list[np.ndarray]) -> None:
    views = [view(picture) for picture in pictures[:7]] + [view(pictures[7][:90, :100])]
    boxes = [BOXES[: i % 4] for i in range(8)]
    together = segmenter.segment(views, boxes)
    assert [len(masks) for masks in together] == [i % 4 for i in range(8)]
    for one, xyxy, masks in zip(views, boxes, together, strict=True):
        (alone,) = segmenter.segment([one], [xyxy])
        for a, b in zip(alone, masks, strict=True):
            assert (a is None) == (b is None)
            assert a is None or (a != b).mean() < 1e-3  # a pixel on the edge may turn by rounding


def test_no_boxes_and_no_views_cost_nothing(segmenter: Any, pictures: list[np.ndarray]) -> None:
    assert segmenter.segment([], []) == []
    assert segmenter.segment([view(pictures[0])], [np.zeros((0, 4), np.float32)]) == [[]]


def test_sam2_is_fed_a_stretched_picture_and_boxes_in_it(
    folder_of: Callable[..., Path], pictures: list[np.ndarray]
) -> None:
    segmenter = Sam2(folder_of("sam2"), "tiny")
    fed: dict[str, Any] = {}

    class Net:
        def get_image_embeddings(self, pixels: torch.Tensor) -> list[torch.Tensor]:
            fed["pixels"] = pixels
            return [torch.zeros(1, 1)]

        def __call__(self, **inputs: Any) -> Any:
            fed.update(inputs)
            logits = torch.full((1, 4, 1, 32, 32), -1.0)
            logits[..., :, 16:] = 1.0  # the right half of the picture
            return SimpleNamespace(pred_masks=logits)

    segmenter._model = replace(segmenter._model, net=Net())
    (masks,) = segmenter.segment([view(pictures[0])], [BOXES])
    expected = literal.normalised(literal.resized(pictures[0], 128, 128, literal.triangle, 1.0), *literal.IMAGENET)
    np.testing.assert_allclose(fed["pixels"][0], expected, atol=1.01 / 255 / 0.224)
    scaled = [[box[0] * 128 / 160, box[1] * 128 / 120, box[2] * 128 / 160, box[3] * 128 / 120] for box in BOXES]
    np.testing.assert_allclose(fed["input_boxes"][0], scaled, rtol=1e-5)
    assert fed["multimask_output"] is False
    assert masks[0] is None  # nothing of it lies in the right half: the whole box
    assert masks[1].tolist() == (np.arange(160) >= 80)[None].repeat(120, axis=0).tolist()
    assert masks[2] is None
    assert masks[3].all()


def test_mobile_sam_is_fed_a_picture_with_its_longer_side_made_whole(pictures: list[np.ndarray]) -> None:
    picture, scale = pad_to_square(pictures[0], 128)
    expected = literal.normalised(literal.resized(pictures[0], 96, 128, literal.triangle, 1.0), *literal.IMAGENET)
    np.testing.assert_allclose(picture[0, :, :96], expected, atol=1.01 / 255 / 0.224)
    assert not picture[0, :, 96:].any()
    np.testing.assert_allclose(scale, [0.8, 0.8])


def test_mobile_sam_says_what_its_network_says_of_each_box(
    folder_of: Callable[..., Path], pictures: list[np.ndarray]
) -> None:
    """The ONNX files against the network that they were made of, with the paper's steps after it written out."""
    (masks,) = MobileSam(folder_of("mobile_sam_onnx"), "tiny").segment([view(pictures[0])], [BOXES])
    picture, _ = pad_to_square(pictures[0], 128)
    sam = tiny.sam()
    boxes = torch.from_numpy(BOXES * 0.8)[None]
    with torch.inference_mode():
        out = sam(pixel_values=torch.from_numpy(picture), input_boxes=boxes, multimask_output=False)
        square = torch.nn.functional.interpolate(out.pred_masks[0], (128, 128), mode="bilinear")
        whole = torch.nn.functional.interpolate(square[..., :96, :128], (120, 160), mode="bilinear")[:, 0] > 0
    for mask, box, expected in zip(masks, BOXES.tolist(), whole.numpy(), strict=True):
        x0, y0, x1, y1 = box_cells(tuple(box), 160, 120)
        inside = expected[y0:y1, x0:x1]
        assert (mask is None) == (not inside.any())
        assert mask is None or (mask != inside).mean() < 2e-3


def test_half_a_mobile_sam_is_refused(folder_of: Callable[..., Path], tmp_path: Path) -> None:
    whole = folder_of("mobile_sam_onnx")
    (tmp_path / "encoder.onnx").write_bytes((whole / "encoder.onnx").read_bytes())
    with pytest.raises(PerceptionError, match=r"no decoder.onnx: expected both"):
        MobileSam(tmp_path, "half")
    (tmp_path / "decoder.onnx").write_bytes((whole / "encoder.onnx").read_bytes())
    with pytest.raises(PerceptionError, match=r"point_coords.*Export them anew"):
        MobileSam(tmp_path, "twice the encoder")
    (tmp_path / "decoder.onnx").write_bytes((whole / "decoder.onnx").read_bytes()[:1000])
    with pytest.raises(PerceptionError, match=r"decoder.onnx can't be loaded"):
        MobileSam(tmp_path, "cut off")


def test_an_encoder_of_any_size_gets_pictures_of_the_published_one(
    folder_of: Callable[..., Path], tmp_path: Path
) -> None:
    folder = folder_of("mobile_sam_onnx")
    assert OnnxNetwork(folder, Runtime()).side == 128
    encoder = onnx.load(folder / "encoder.onnx")
    for axis, name in ((2, "height"), (3, "width")):
        encoder.graph.input[0].type.tensor_type.shape.dim[axis].dim_param = name
    onnx.save(encoder, tmp_path / "encoder.onnx")
    (tmp_path / "decoder.onnx").write_bytes((folder / "decoder.onnx").read_bytes())
    assert OnnxNetwork(tmp_path, Runtime()).side == 1024


@pytest.mark.parametrize("lacking", ["mobile_sam", "torch"])
def test_a_checkpoint_without_its_package_says_what_to_install(
    lacking: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, lacking, None)
    monkeypatch.delitem(sys.modules, "surveilnav.perception.segmenters.mobile_sam_torch", raising=False)
    with pytest.raises(
        PerceptionError,
        match=r"pip install 'surveilnav\[perception-torch,mobile-sam\]', or .*PERCEPTION__SEGMENTER=sam2.1-tiny",
    ):
        MobileSam(tmp_path / "mobile_sam.pt", "torch")


def test_what_is_no_checkpoint_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = ModuleType("mobile_sam")
    package.sam_model_registry = {"vit_t": torch.nn.Identity}
    exporting = ModuleType("mobile_sam.utils.onnx")
    exporting.SamOnnxModel = None
    for module in (package, ModuleType("mobile_sam.utils"), exporting):
        monkeypatch.setitem(sys.modules, module.__name__, module)
    (tmp_path / "mobile_sam.pt").write_bytes(b"no checkpoint")
    with pytest.raises(PerceptionError, match=r"mobile_sam.pt isn't MobileSAM's checkpoint"):
        MobileSam(tmp_path / "mobile_sam.pt", "torch")
