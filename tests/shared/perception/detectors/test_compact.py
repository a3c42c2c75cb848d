"""What surrounds the network in its ONNX file: letterbox and places."""

from __future__ import annotations

import numpy as np
import pytest

from surveilnav.perception.detectors.compact import letterboxed, places


@pytest.mark.parametrize(
    ("size", "box"),
    [((480, 640), (320, 416)), ((1280, 1280), (416, 416)), ((100, 50), (416, 224)), ((240, 320), (320, 416))],
)
def test_the_longer_side_fits_and_both_are_multiples_of_32(size: tuple[int, int], box: tuple[int, int]) -> None:
    out, ratio = letterboxed(np.full((*size, 3), 200, np.uint8), 416)
    assert out.shape == (*box, 3)
    rows, columns = (round(side * ratio) for side in size)
    assert max(rows, columns) == 416
    assert (out[:rows, :columns] == 200).all()
    assert (out[rows:] == 114).all()
    assert (out[:, columns:] == 114).all()


def test_places_are_the_middles_of_their_cells() -> None:
    points = places(64, 96)
    assert len(points) == 8 * 12 + 4 * 6 + 2 * 3
    assert points[[0, 1, 12, 96, -1]].tolist() == [[4, 4], [12, 4], [4, 12], [8, 8], [80, 48]]
