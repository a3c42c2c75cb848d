"""MobileSAM's checkpoint on random weights: by its package, and as the ONNX files that docs/use/models.md writes.

pip install 'surveilnav[mobile-sam]'     # else this file is skipped: torchvision must be that of the installed torch

"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch

from surveilnav.geometry import Pinhole
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.segmenters.mobile_sam import MobileSam
from surveilnav.sensing.views import box_cells

mobile_sam = pytest.importorskip(
    "mobile_sam", reason="needs surveilnav[mobile-sam]", exc_type=(ImportError, RuntimeError)
)

DOCS = Path(__file__).parents[2] / "docs" / "use" / "models.md"
BOXES = np.array([[10.4, 10.6, 260.2, 250.9], [0, 0, 160, 120], [100, 60, 319, 239]], np.float32)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(0)
    path = tmp_path_factory.mktemp("mobile-sam") / "mobile_sam.pt"
    torch.save(mobile_sam.sam_model_registry["vit_t"]().state_dict(), path)
    return path


@pytest.fixture(scope="module")
def view() -> RgbdView:
    """Of (240, 320) pixels: colours that change slowly."""
    rgb = np.random.default_rng(5).integers(0, 255, (6, 8, 3)).repeat(40, axis=0).repeat(40, axis=1).astype(np.uint8)
    return RgbdView(rgb, np.ones((240, 320), np.float32), Pinhole.from_hfov(320, 240, 1.3))


@pytest.mark.slow
def test_it_cuts_out_what_its_own_predictor_does(checkpoint: Path, view: RgbdView) -> None:
    predictor = mobile_sam.SamPredictor(mobile_sam.sam_model_registry["vit_t"](str(checkpoint)).eval())
    predictor.set_image(view.rgb)
    (masks,) = MobileSam(checkpoint, "random").segment([view], [BOXES])
    for mask, box in zip(masks, BOXES, strict=True):
        whole, _, _ = predictor.predict(box=box, multimask_output=False)
        x0, y0, x1, y1 = box_cells(tuple(box.tolist()), 320, 240)
        assert mask is not None
        assert 0.01 < mask.mean() < 0.99
        assert (mask != whole[0, y0:y1, x0:x1]).mean() < 0.02  # it enlarges pictures by another filter


@pytest.mark.slow
def test_the_documented_export_says_the_same(checkpoint: Path, view: RgbdView, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(checkpoint.parent)
    (lines,) = re.findall(r"```python\n(.*?mobile_sam.*?)```", DOCS.read_text(encoding="utf-8"), re.DOTALL)
    exec(compile(lines, str(DOCS), "exec"), {})
    (masks,) = MobileSam(checkpoint, "checkpoint").segment([view], [BOXES])
    (exported,) = MobileSam(checkpoint.parent / "mobile-sam", "files").segment([view], [BOXES])
    for mask, other in zip(masks, exported, strict=True):
        assert mask is not None
        assert other is not None
        assert (mask != other).mean() < 1e-3
