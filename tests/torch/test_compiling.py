"""``compiled``: what detectors, segmenters and embedders call of a network is what PyTorch compiled."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from surveilnav.geometry import Pinhole
from surveilnav.perception import parts, torch_model
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime

WORDS = ("couch", "bed")
BOX = np.array([[20, 20, 90, 80]], np.float32)
Folder = Callable[..., Path]


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> Iterator[Counter[str]]:
    """By entry, how often compiled code of it ran. Stands in for a GPU: there is a compiler that counts."""
    counts: Counter[str] = Counter()
    compile_one = torch.compile

    def counting(entry: Any) -> Any:
        def backend(graph: Any, _: Any) -> Any:
            def run(*inputs: Any) -> Any:
                counts[entry.__name__] += 1
                return graph(*inputs)

            return run

        return compile_one(entry, backend=backend)

    monkeypatch.setattr(torch_model, "_compiles", lambda runtime, device: runtime.compiled)
    monkeypatch.setattr(torch, "compile", counting)
    yield counts
    torch._dynamo.reset()


@pytest.mark.parametrize("name", ["grounding_dino", "owlv2", "omdet_turbo"])
def test_a_detector(name: str, folder_of: Folder, pictures: list[np.ndarray], ran: Counter[str]) -> None:
    found = [
        parts.load_detector(str(folder_of(name)), Runtime("cpu", compiled=compiled), threshold=0.0).detect(
            pictures[:1], [WORDS]
        )[0]
        for compiled in (False, True)
    ]
    assert ran["forward"]
    np.testing.assert_allclose(found[0].xyxy, found[1].xyxy, atol=1e-2)


@pytest.mark.parametrize("name", ["clip", "siglip"])
def test_an_embedder(name: str, folder_of: Folder, pictures: list[np.ndarray], ran: Counter[str]) -> None:
    plain = parts.load_embedder(str(folder_of(name)), Runtime("cpu"))
    assert not ran
    embedder = parts.load_embedder(str(folder_of(name)), Runtime("cpu", compiled=True))
    ran.clear()
    np.testing.assert_allclose(embedder.embed_texts(["a bed"]), plain.embed_texts(["a bed"]), atol=1e-5)
    assert set(ran) == {"get_text_features"}
    boxes, rows = [Boxes.empty(WORDS)], [np.zeros(0, np.int64)]
    (view,), (expected,) = (e.embed_views(pictures[:1], boxes, rows) for e in (embedder, plain))
    np.testing.assert_allclose(view.image, expected.image, atol=1e-5)
    assert set(ran) == {"get_text_features", "get_image_features"}


def test_a_segmenter(folder_of: Folder, pictures: list[np.ndarray], ran: Counter[str]) -> None:
    view = RgbdView(pictures[0], np.full((120, 160), 2.0, np.float32), Pinhole.from_hfov(160, 120, 1.3))
    plain = parts.load_segmenter(str(folder_of("sam2")), Runtime("cpu")).segment([view], [BOX])
    compiled = parts.load_segmenter(str(folder_of("sam2")), Runtime("cpu", compiled=True)).segment([view], [BOX])
    assert {"get_image_embeddings", "forward"} <= set(ran)
    for a, b in zip(plain[0], compiled[0], strict=True):
        assert (a is None and b is None) or (a is not None and b is not None and np.mean(a != b) < 0.01)
