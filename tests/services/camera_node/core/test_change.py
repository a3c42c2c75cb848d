from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
import pytest

from surveilnav.services.camera_node.core.change import ChangeDetector
from tests import streams

SIZE = (640, 360)


def hour(light: float = 0.0, flicker: float = 0.0, compressed: bool = True, n: int = 120) -> Iterator[np.ndarray]:
    """Pictures of a still room in which brightness drifts by ``light`` of 255 in all and flickers by ``flicker``."""
    rng = np.random.default_rng(5)
    for t in range(n):
        rgb = streams.room(t, SIZE).astype(np.float32) * (1 + light * t / n / 128)
        rgb = np.clip(rgb + flicker * rng.normal(), 0, 255).astype(np.uint8)
        if compressed:
            rgb = cv2.imdecode(cv2.imencode(".jpg", rgb, [cv2.IMWRITE_JPEG_QUALITY, 60])[1], cv2.IMREAD_COLOR)
        yield rgb


def n_sent(pictures: Iterator[np.ndarray]) -> int:
    detector, n = ChangeDetector(), 0
    for rgb in pictures:
        if detector.observe(rgb):
            detector.sent(rgb)
            n += 1
    return n


@pytest.mark.parametrize(("light", "flicker"), [(0, 0), (30, 0), (-50, 0), (0, 6)])
def test_noise_compression_daylight_and_flicker_send_nothing(light: float, flicker: float) -> None:
    assert n_sent(hour(light, flicker)) == 1


def person(rgb: np.ndarray, x: int, height_px: int = 90) -> np.ndarray:
    out = rgb.copy()
    cv2.rectangle(out, (x, 180), (x + height_px // 3, 180 + height_px), (35, 40, 60), -1)
    return out


def test_a_person_who_comes_in_stays_and_goes_is_sent_twice_and_while_walking() -> None:
    detector = ChangeDetector()
    sent = []
    for t in range(60):
        rgb = streams.room(t, SIZE)
        if 20 <= t < 40:
            rgb = person(rgb, 300)
        if detector.observe(rgb):
            detector.sent(rgb)
            sent.append(t)
    assert sent == [0, 20, 40]


def test_a_chair_that_was_moved_is_sent_although_light_changes_too() -> None:
    detector = ChangeDetector()
    before = cv2.rectangle(streams.room(1, SIZE), (400, 250), (440, 300), (30, 90, 40), -1)
    after = cv2.rectangle(streams.room(2, SIZE), (470, 250), (510, 300), (30, 90, 40), -1)
    detector.observe(before)
    detector.sent(before)
    assert detector.observe(np.clip(after * 1.15, 0, 255).astype(np.uint8))


def test_the_switch_to_infrared_is_sent_once() -> None:
    def night(t: int) -> np.ndarray:
        grey = cv2.cvtColor(streams.room(t, SIZE), cv2.COLOR_RGB2GRAY).astype(np.float32)
        vignette = 1.2 - 0.9 * np.abs(np.linspace(-1, 1, SIZE[0]))[None]
        return np.repeat(np.clip(grey * vignette, 0, 255).astype(np.uint8)[..., None], 3, -1)

    pictures = [*(streams.room(t, SIZE) for t in range(10)), *(night(t) for t in range(10, 40))]
    assert n_sent(iter(pictures)) == 2
