"""Finds an AprilTag of the family 36h11 in a picture, and draws one for printing."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

#: Number of different tags in the family.
TAGS = 587
_MODULES = 8  # of the black square, along one side
_MAX_REFINEMENT_PX = 5


class TagDetector:
    """Finds the tag with one number. Pictures that show it twice, such as beside a spare print, count as without it."""

    def __init__(self, id: int) -> None:
        if not 0 <= id < TAGS:
            raise ValueError(f"the family 36h11 has the tags 0 to {TAGS - 1}, got {id}")
        self._id = id
        settings = cv2.aruco.DetectorParameters()
        settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        settings.cornerRefinementWinSize = _MAX_REFINEMENT_PX
        # A window wider than this share of a module would reach the pattern's next edge.
        settings.relativeCornerRefinmentWinSize = 0.4
        settings.minMarkerPerimeterRate = 0.02  # of the picture's longer side: 10 px a side at 1920
        self._detector = cv2.aruco.ArucoDetector(_dictionary(), settings)

    def corners(self, rgb: NDArray[np.uint8]) -> NDArray[np.float64] | None:
        """(4, 2) pixels of the black square's corners, clockwise from the pattern's top left; None: the tag isn't there.

        Args:
            rgb: (height, width, 3), distorted as it comes from the camera.
        """
        found, ids, _ = self._detector.detectMarkers(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
        if ids is None:
            return None
        own = [corners for corners, id in zip(found, ids.ravel(), strict=True) if id == self._id]
        return np.asarray(own[0], np.float64).reshape(4, 2) if len(own) == 1 else None


def tag_picture(id: int, module_px: int = 100) -> NDArray[np.uint8]:
    """(height, width) uint8: the tag with the white margin of one module that it needs."""
    black = cv2.aruco.generateImageMarker(_dictionary(), id, _MODULES * module_px, borderBits=1)
    return np.asarray(
        cv2.copyMakeBorder(black, *[module_px] * 4, cv2.BORDER_CONSTANT, value=255),  # type: ignore[call-overload]
        np.uint8,
    )


def tag_corners(size_m: float) -> NDArray[np.float64]:
    """(4, 3): corners of the black square in the tag's frame, in the order of ``TagDetector.corners``.

    The frame's origin is the tag's centre; x points to the right on the pattern, y up, and z out of it to who looks at it.
    """
    half_m = size_m / 2
    return np.array([[-half_m, half_m, 0.0], [half_m, half_m, 0.0], [half_m, -half_m, 0.0], [-half_m, -half_m, 0.0]])


def _dictionary() -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
