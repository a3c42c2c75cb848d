"""CLIP and SigLIP: unit vectors, batches, what the network is fed, squares around boxes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.perception.boxes import Boxes
from surveilnav.perception.embedders.clip import Clip, crop_square
from tests.torch import literal

XYXY = np.array([[10, 10, 60, 50], [0, 0, 160, 120], [100, 5, 104, 115]], np.float32)


@pytest.fixture(params=["clip", "siglip"])
def embedder(request: pytest.FixtureRequest, folder_of: Callable[..., Path]) -> Clip:
    return Clip(folder_of(request.param), request.param)


def boxes_of(n: int) -> Boxes:
    return Boxes(XYXY[:n], np.ones((n, 1), np.float32), ("couch",))


def test_vectors_are_units_of_one_space(embedder: Clip, pictures: list[np.ndarray]) -> None:
    (seen,) = embedder.embed_views(pictures[:1], [boxes_of(3)], [np.array([2, 0])])
    texts = embedder.embed_texts(["seems like there is a couch", "bed"])
    assert seen.image.shape == (embedder.dim,)
    assert seen.objects.shape == (2, embedder.dim)
    assert texts.shape == (2, embedder.dim)
    for vectors in (seen.image[None], seen.objects, texts):
        assert vectors.dtype == np.float32
        np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-5)
    assert embedder.embed_texts([]).shape == (0, embedder.dim)


def test_eight_at_once_are_eight_one_by_one(embedder: Clip, pictures: list[np.ndarray]) -> None:
    shown = [*pictures[:7], pictures[7][:90, :100]]
    boxes, rows = [boxes_of(i % 4) for i in range(8)], [np.arange(i % 4) for i in range(8)]
    together = embedder.embed_views(shown, boxes, rows)
    for i, seen in enumerate(together):
        (alone,) = embedder.embed_views([shown[i]], [boxes[i]], [rows[i]])
        np.testing.assert_allclose(seen.image, alone.image, atol=1e-5)
        np.testing.assert_allclose(seen.objects, alone.objects, atol=1e-5)
    assert len({seen.image.tobytes() for seen in together}) == 8
    assert embedder.embed_views([], [], []) == []


def test_texts_do_not_touch_each_other(embedder: Clip) -> None:
    texts = ["a bed", "seems like there is a fire extinguisher", "x"]
    together = embedder.embed_texts(texts)
    for text, vector in zip(texts, together, strict=True):
        np.testing.assert_allclose(embedder.embed_texts([text])[0], vector, atol=1e-5)
    np.testing.assert_allclose(embedder.embed_texts(["A Bed"])[0], together[0], atol=1e-5)


def test_the_sides_of_a_wide_picture_count(embedder: Clip, pictures: list[np.ndarray]) -> None:
    other = pictures[0].copy()
    other[:, :12] = 255 - other[:, :12]  # CLIP's own preparation would cut this off
    a, b = (seen.image for seen in embedder.embed_views([pictures[0], other], [boxes_of(0)] * 2, [np.arange(0)] * 2))
    assert np.abs(a - b).max() > 1e-4


def test_clip_is_fed_pictures_as_its_paper_prepares_them(
    folder_of: Callable[..., Path], pictures: list[np.ndarray]
) -> None:
    embedder, fed = Clip(folder_of("clip"), "tiny"), {}

    def features(**inputs: Any) -> Any:
        fed.update(inputs)
        return SimpleNamespace(pooler_output=torch.full((2, 24), 2.0))

    embedder._model = replace(embedder._model, net=SimpleNamespace(get_image_features=features))
    (seen,) = embedder.embed_views(pictures[:1], [boxes_of(1)], [np.arange(1)])
    np.testing.assert_allclose(seen.objects, 24**-0.5, atol=1e-6)
    crop = pictures[0][0:60, 5:65]  # 60 = 50 * 1.2 around (35, 30)
    for tensor, picture in zip(fed["pixel_values"], (pictures[0], crop), strict=True):
        expected = literal.normalised(literal.resized(picture, 32, 32, literal.cubic, 2.0), *literal.OPENAI)
        np.testing.assert_allclose(tensor, expected, atol=2.01 / 255 / 0.26)
        assert np.abs(tensor.numpy() - expected).mean() < 2e-3


coordinates = st.floats(-20, 180, allow_nan=False)


@given(coordinates, coordinates, st.floats(0, 250), st.floats(0, 250))
def test_squares_hold_what_shows_of_their_box(x0: float, y0: float, width: float, height: float) -> None:
    rows, columns = np.mgrid[0:120, 0:160]
    image = np.stack([rows, columns, np.full_like(rows, 255)], axis=2).astype(np.uint8)  # each pixel says where it is
    box = np.array([x0, y0, x0 + width, y0 + height], np.float32)
    crop = crop_square(image, box)
    assert crop.shape[0] == crop.shape[1] >= 2
    shown = {(int(r), int(c)) for r, c, blue in crop.reshape(-1, 3) if blue == 255}
    low_x, high_x = np.clip([np.ceil(x0), np.floor(x0 + width) - 1], 0, 159)
    low_y, high_y = np.clip([np.ceil(y0), np.floor(y0 + height) - 1], 0, 119)
    inside = x0 >= 0 and y0 >= 0 and x0 + width <= 160 and y0 + height <= 120 and width >= 2 and height >= 2
    if inside and low_x <= high_x and low_y <= high_y:
        assert {(int(low_y), int(low_x)), (int(high_y), int(high_x))} <= shown
