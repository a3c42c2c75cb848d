"""Crops of pictures around a box."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.gateway.core.crops import _MOST_PX, crop

_PICTURE = np.zeros((300, 400, 3), np.uint8)
_PICTURE[100:200, 150:250] = (0, 0, 255)
JPEG = cv2.imencode(".jpg", _PICTURE)[1].tobytes()


def shown(box):
    return cv2.imdecode(np.frombuffer(crop(JPEG, box), np.uint8), cv2.IMREAD_COLOR)


def test_the_box_is_in_the_middle_with_what_is_around_it():
    picture = shown((150, 100, 250, 200))
    assert picture.shape == (170, 170, 3)  # 35 % of 100 px on each side
    assert picture[85, 85, 2] > 200
    assert picture[5, 5].max() < 40


@given(st.tuples(*[st.floats(-1e4, 1e4)] * 4))
def test_any_box_gives_a_small_picture_or_is_refused(box):
    try:
        picture = shown(box)
    except ValueError:
        return
    assert max(picture.shape) <= _MOST_PX


@pytest.mark.parametrize(
    "box", [(), (1, 2, 3), (None, 0, 10, 10), (float("nan"), 0, 9, 9), (500, 0, 600, 10), (9, 9, 9, 9)]
)
def test_what_is_no_box_is_refused(box):
    with pytest.raises(ValueError):
        crop(JPEG, box)


@pytest.mark.parametrize("data", [b"", b"no picture", JPEG[:40]])
def test_what_is_no_picture_is_refused(data):
    with pytest.raises(ValueError):
        crop(data, (0, 0, 10, 10))
