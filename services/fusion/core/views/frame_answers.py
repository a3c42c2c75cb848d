"""What a camera says of a robot's frame once both are compared: it agrees (None), asks for a correction, or it can't be told."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from surveilnav.robot_frame.drift import is_large
from surveilnav.robot_frame.planar import PlanarTransform
from surveilnav.services.fusion.core.views.pose_fit import PoseCorrection, score_poses

#: Unclear corrections of several cameras count if they are this similar, and not larger than this.
_COINCIDE_M, _COINCIDE_RAD, _MAX_UNCLEAR_M = 0.2, math.radians(2.5), 0.9
#: A test is clear if points fit so well, and so many times as well as by the alternative.
_MIN_TEST_SCORE, _TIMES_TESTED = 0.4, 1.5
#: The description is right if points fit so well by it, and so nearly as well as by the best correction.
_MIN_SCORE, _TIMES_DESCRIBED = 0.45, 1.3
#: A correction is asked for if points fit so well by it, and so many times as well.
_MIN_CORRECTED, _TIMES_CORRECTED = 0.5, 1.5
_Points = NDArray[np.float64]


def add_correction(
    answers: dict[str, PlanarTransform | None],
    unclear: dict[str, PlanarTransform],
    camera: str,
    found: PoseCorrection,
    p: _Points,
) -> None:
    """Adds a camera's answer about a robot at (2,) ``p``: a clear correction, None for agreement, else perhaps to ``unclear``."""
    turn = PlanarTransform(0.0, 0.0, found.yaw_rad)
    x, y = p + np.array([found.x_m, found.y_m]) - turn.apply(p)
    correction = PlanarTransform(float(x), float(y), found.yaw_rad)
    large = is_large(correction, p)
    is_much_better = found.score >= max(_MIN_CORRECTED, _TIMES_CORRECTED * found.described_score)
    if large and found.is_clear and is_much_better:
        answers[camera] = correction
    elif found.score >= _MIN_SCORE:
        is_as_described = found.score <= _TIMES_DESCRIBED * found.described_score
        if is_as_described or (found.is_clear and not large):
            answers[camera] = None
    at_the_end = max(abs(found.x_m), abs(found.y_m)) > _MAX_UNCLEAR_M  # of what was tried: the best may lie beyond it
    if camera not in answers and large and not at_the_end and found.score >= _TIMES_DESCRIBED * found.described_score:
        unclear[camera] = correction


def add_coinciding(
    answers: dict[str, PlanarTransform | None], unclear: Mapping[str, PlanarTransform], p: _Points
) -> None:
    """Adds unclear corrections that coincide: by chance, those of three cameras don't, nor does one with a clear one."""
    clear = {camera: T for camera, T in answers.items() if T is not None}
    corrections = {**unclear, **clear}
    for camera, T in unclear.items():
        same = {name for name, other in corrections.items() if name != camera and _coincide(T, other, p)}
        if len(same) >= 2 or same & clear.keys():
            answers[camera] = T


def _coincide(one: PlanarTransform, other: PlanarTransform, p: _Points) -> bool:
    off_m, off_rad = one.difference(other, p)
    return off_m <= _COINCIDE_M and off_rad <= _COINCIDE_RAD


def add_tested(
    answers: dict[str, PlanarTransform | None],
    camera: str,
    hypothesis: PlanarTransform,
    points: _Points,
    others: _Points,
    place: tuple[float, float, float, float],
) -> None:
    """Tests another camera's correction: adds it if this camera's points clearly fit better with it, None if without it."""
    p = np.array(place[:2])
    dx_m, dy_m = (hypothesis.apply(p) - p).tolist()
    by_robot, corrected = score_poses(points, others, p, place[3], [(0.0, 0.0, 0.0), (hypothesis.yaw_rad, dx_m, dy_m)])
    if corrected >= max(_MIN_TEST_SCORE, _TIMES_TESTED * by_robot):
        answers[camera] = hypothesis
    elif by_robot >= max(_MIN_TEST_SCORE, _TIMES_TESTED * corrected):
        answers[camera] = None
