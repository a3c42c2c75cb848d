"""A camera that was knocked is noticed within a minute; light, infrared and people are no alarm."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from surveilnav.services.camera_node.core.shift import ShiftDetector

WIDTH, HEIGHT, HFOV = 480, 360, math.radians(90)
F = WIDTH / 2 / math.tan(HFOV / 2)
K = np.array([[F, 0, WIDTH / 2], [0, F, HEIGHT / 2], [0, 0, 1.0]])


@pytest.fixture(scope="module")
def scene() -> np.ndarray:
    """A furnished wall: rectangles of many sizes, larger than the picture."""
    rng = np.random.default_rng(4)
    picture = np.full((2 * HEIGHT, 2 * WIDTH, 3), 150, np.uint8)
    for _ in range(120):
        x, y = int(rng.integers(2 * WIDTH)), int(rng.integers(2 * HEIGHT))
        w, h = (int(v) for v in rng.integers(15, 120, 2))
        cv2.rectangle(picture, (x, y), (x + w, y + h), [int(v) for v in rng.integers(30, 220, 3)], -1)
    return picture


def seen(scene: np.ndarray, axis: str = "y", angle_deg: float = 0.0) -> np.ndarray:
    """What a camera sees of it after it was turned about its axis."""
    R, _ = cv2.Rodrigues(math.radians(angle_deg) * np.eye(3)["xyz".index(axis)])
    to_picture = K @ R @ np.linalg.inv(K) @ np.array([[1, 0, -WIDTH / 2], [0, 1, -HEIGHT / 2], [0, 0, 1.0]])
    return cv2.warpPerspective(scene, to_picture, (WIDTH, HEIGHT))


def with_noise(rgb: np.ndarray, t: int) -> np.ndarray:
    noisy = rgb + np.random.default_rng(t).normal(0, 4, rgb.shape)
    return cv2.imdecode(
        cv2.imencode(".jpg", np.clip(noisy, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 60])[1],
        cv2.IMREAD_COLOR,
    )


def moved_after_s(pictures: Callable[[int], np.ndarray], seconds: int, knocked_s: int = 0) -> int | None:
    """How long after the knock it is noticed, with one picture per second; None: never."""
    detector = ShiftDetector(HFOV)
    for t in range(seconds):
        detector.observe(with_noise(pictures(t), t), float(t))
        if detector.has_moved:
            return t - knocked_s
    return None


@pytest.mark.parametrize(("axis", "angle_deg"), [("y", 3), ("y", -8), ("x", 3), ("x", -5), ("z", 3), ("z", -6)])
def test_a_knock_is_noticed_within_a_minute_whichever_way(scene, axis, angle_deg):
    knocked_s = 20
    after_s = moved_after_s(lambda t: seen(scene, axis, angle_deg if t >= knocked_s else 0.0), 80, knocked_s)
    assert after_s is not None
    assert 0 < after_s < 60


def light(rgb, t):
    return rgb * (0.4 + 0.6 * (0.5 + 0.5 * math.cos(t / 40)))


def flicker(rgb, t):
    return rgb * (1.0 + 0.25 * math.sin(t * 1.7))


def infrared(rgb, t):
    return rgb if t % 120 < 60 else np.repeat(rgb[..., ::-1].max(axis=-1, keepdims=True) * 0.6 + 40, 3, axis=-1)


def people(rgb, t):
    out = rgb.copy()
    for k in range(3):
        x = (97 * k + 23 * t * (k + 1)) % WIDTH
        cv2.rectangle(out, (x, 120), (x + 50, 330), (40, 50 + 30 * k, 70), -1)
    return out


@pytest.mark.parametrize("what", [light, flicker, infrared, people])
def test_what_isnt_a_knock_is_no_alarm(scene, what):
    still = seen(scene)
    assert moved_after_s(lambda t: what(still, t), 300) is None


def test_a_camera_that_is_turned_back_is_believed_again(scene):
    detector = ShiftDetector(HFOV)
    for t in range(150):
        detector.observe(with_noise(seen(scene, "y", 4.0 if 20 <= t < 80 else 0.0), t), float(t))
        if t == 79:
            assert detector.has_moved
            assert math.degrees(detector.shift_rad) == pytest.approx(4.0, abs=1.0)
    assert not detector.has_moved


def test_a_covered_camera_says_nothing(scene):
    still = seen(scene)
    assert moved_after_s(lambda t: still if t < 20 else np.full_like(still, 20), 100) is None
