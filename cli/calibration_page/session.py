"""One camera's calibration while its page is open: the points so far, the picture and the plan. It solves and writes."""

from __future__ import annotations

import os
from pathlib import Path
from threading import Lock
from typing import Annotated, Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field, FiniteFloat

from surveilnav.camera_pose import Clicks, load_clicks, load_floor_plan
from surveilnav.camera_pose.points import MAX_POINTS, ClickedPoint, ClicksFile, save_clicks
from surveilnav.cameras_file.edit import write_camera
from surveilnav.cli.calibrating import Calibrated, calibrate, camera_entry, camera_picture, require_match
from surveilnav.cli.calibration_page.solution import solution
from surveilnav.errors import ConfigError, PoseError, SurveilNavError
from surveilnav.file_entry import Entry

_JPEG_QUALITY = 95  # people click to a pixel


class Pair(Entry):
    """A point in the picture, and the same one on the plan. Pixel (0, 0) is the centre of the top left one."""

    px: tuple[FiniteFloat, FiniteFloat]
    plan_px: tuple[FiniteFloat, FiniteFloat]
    z_m: Annotated[FiniteFloat, Field(ge=-20, le=50)] = 0.0


class Pairs(Entry):
    """All that a person decides on the page."""

    points: list[Pair] = Field(max_length=MAX_POINTS)
    fit_hfov: bool = False


class Session:
    """A camera's calibration. Its methods may be called on several threads.

    The file of cameras is read each time, so that a lens or a stream that somebody corrects in it counts at once.

    Args:
        clicks_file: read if it is there, and written by ``save_clicks``.
        picture_file: None: pictures come from the camera's stream, the first when it is asked for.

    Raises:
        ConfigError: a file has a mistake, or they don't fit together.
    """

    def __init__(
        self,
        camera: str,
        cameras_file: Path,
        plan_file: Path,
        clicks_file: Path,
        picture_file: Path | None = None,
        fit_hfov: bool = False,
    ) -> None:
        entry, _ = camera_entry(camera, cameras_file)
        self.camera = camera
        self._cameras_file, self._plan_file, self._clicks_file = cameras_file, plan_file, clicks_file
        self._plan = load_floor_plan(plan_file)
        require_match(entry, self._plan, plan_file, fit_hfov)
        self._picture_file = picture_file
        self._jpeg = b"" if picture_file is None else _jpeg(camera_picture(entry, picture_file, cameras_file))
        self._pairs = Pairs(points=self._points_of_file(), fit_hfov=fit_hfov)
        self._lock, self._picture_lock = Lock(), Lock()

    def state(self) -> dict[str, Any]:
        """What the page begins with.

        Raises:
            ConfigError: the file of cameras can no longer be used.
        """
        entry, _ = camera_entry(self.camera, self._cameras_file)
        return {
            "camera": entry.name,
            "label": entry.label,
            "floor": entry.floor,
            "width_px": entry.lens.width_px,
            "height_px": entry.lens.height_px,
            "hfov_deg": entry.lens.hfov_deg,
            "from_stream": self._picture_file is None,
            "cameras_file": str(self._cameras_file),
            "clicks_file": str(self._clicks_file),
            "plan": {
                "width_px": self._plan.width_px,
                "height_px": self._plan.height_px,
                "resolution_m": self._plan.resolution_m,
            },
            **self._pairs.model_dump(),
        }

    def plan_png(self) -> bytes:
        """The plan's picture in a format that browsers know, which PGM isn't.

        Raises:
            ConfigError: it can no longer be read.
        """
        picture = cv2.imread(str(self._plan.picture), cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise ConfigError(f"{self._plan.picture}: the plan's picture can no longer be read")
        return cv2.imencode(".png", picture)[1].tobytes()

    def picture(self, new: bool = False) -> bytes:
        """The camera's picture as JPEG. ``new``: another one, if it comes from the stream.

        Raises:
            ConfigError: there is none, or of another size than the lens is given for.
        """
        with self._picture_lock:
            if not self._jpeg or (new and self._picture_file is None):
                entry, _ = camera_entry(self.camera, self._cameras_file)
                self._jpeg = _jpeg(camera_picture(entry, None, self._cameras_file))
            return self._jpeg

    def solve(self, pairs: Pairs) -> dict[str, Any]:
        """Keeps the points, and says what pose follows from them: ``solution``, or else ``problem``."""
        self._pairs = pairs  # at once: whoever reloads the page while an older pose is computed gets them
        with self._lock:
            try:
                made = self._calibrated(pairs)
            except SurveilNavError as error:
                wrong = error.points if isinstance(error, PoseError) else ()
                return {"problem": {"message": str(error), "points": wrong}}
        return {"solution": solution(made, self._plan)}

    def save_pose(self, pairs: Pairs) -> str:
        """Writes the pose that follows from the points into the file of cameras; says what it wrote.

        Raises:
            SurveilNavError: there is no pose, or the file can't be written.
        """
        with self._lock:
            self._pairs = pairs
            values = self._calibrated(pairs).yaml_values()
            write_camera(self._cameras_file, self.camera, values)
        written = ", ".join(f"{name} {value}" for name, value in values.items())
        return f"{self._cameras_file}: {self.camera} has its new place: {written}"

    def save_clicks(self, pairs: Pairs) -> str:
        """Writes the points into the file of clicks; says so.

        Raises:
            ConfigError: there are none, or the file can't be written.
        """
        if not pairs.points:
            raise ConfigError("there is no point to save yet")
        with self._lock:
            self._pairs = pairs
            plan = os.path.relpath(self._plan_file, self._clicks_file.parent)
            points = [self._clicked(pair) for pair in pairs.points]
            save_clicks(self._clicks_file, ClicksFile(camera=self.camera, plan=plan, points=points))
        return f"{self._clicks_file}: {len(points)} points written"

    def _calibrated(self, pairs: Pairs) -> Calibrated:
        pixels = np.array([pair.px for pair in pairs.points]).reshape(-1, 2)
        xy = self._plan.world_of(np.array([pair.plan_px for pair in pairs.points]).reshape(-1, 2))
        p_floor = np.column_stack([xy, [pair.z_m for pair in pairs.points]])
        clicks = Clicks(self.camera, pixels, p_floor, tuple(range(1, len(pixels) + 1)), self._plan)
        return calibrate(self.camera, clicks, self._plan_file, self._cameras_file, pairs.fit_hfov)

    def _clicked(self, pair: Pair) -> ClickedPoint:
        """In metres where the plan's picture doesn't show its place: so a file of clicks may say."""
        column, row = pair.plan_px
        if -0.5 <= column <= self._plan.width_px - 0.5 and -0.5 <= row <= self._plan.height_px - 0.5:
            return ClickedPoint(px=pair.px, plan_px=pair.plan_px, z_m=pair.z_m)
        x, y = self._plan.world_of(np.array(pair.plan_px))
        return ClickedPoint(px=pair.px, xy_m=(float(x), float(y)), z_m=pair.z_m)

    def _points_of_file(self) -> list[Pair]:
        if not self._clicks_file.exists():
            return []
        clicks = load_clicks(self._clicks_file)
        if clicks.camera != self.camera:
            raise ConfigError(
                f"{self._clicks_file}: these are clicks of camera {clicks.camera!r}, not of {self.camera!r}"
            )
        places = self._plan.pixels_of(clicks.p_floor)
        return [
            Pair(px=(float(u), float(v)), plan_px=(float(column), float(row)), z_m=float(z))
            for (u, v), (column, row), z in zip(clicks.pixels, places, clicks.p_floor[:, 2], strict=True)
        ]


def _jpeg(bgr: NDArray[np.uint8]) -> bytes:
    return cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])[1].tobytes()
