"""Cameras whose description is wrong: none of their views is believed until they are described anew.

Three things show that a description is wrong:

- A view has hardly any floor, but has much once one common mistake is undone (``plausibility``). Such a view is refused at once.
- Several views of one camera show a floor that leans, or lies at another height, all in the same way (``floor_plane``).
- Others look through what the camera has measured, where both have looked, and it isn't a robot's frame that is wrong
  (``robot_frames``). Then it is matched with what they have measured, which may show how it was turned or moved (``pose_fit``).

Views that came before this was known may be in the maps. So the camera must be removed from them (``removal.sources_to_remove``).
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.config import ValidationConfig
from surveilnav.services.fusion.core.maps.cloud import VoxelCloud
from surveilnav.services.fusion.core.maps.provenance import Agreement
from surveilnav.services.fusion.core.views.floor_plane import FloorPlane, fit_floor_plane
from surveilnav.services.fusion.core.views.plausibility import find_mistake
from surveilnav.services.fusion.core.views.pose_fit import PoseCorrection, fit_pose, points_to_fit
from surveilnav.services.fusion.core.views.robot_frames import RobotFrames
from surveilnav.services.fusion.core.views.validation import ViewError, ViewValidator

#: So many pictures must show a mistake, and the newest pictures of so large a share of the camera's views.
_MIN_PICTURES, _MIN_SHARE = 2, 0.25
#: A plane is taken for the floor if so many of the view's points are on it, and it extends so far.
_PLANE_SHARE, _PLANE_SPREAD_M = 0.15, 0.25
#: Furniture shows as a floor that is too high. Then some real floor is usually seen, too: more than this share of the points.
_MAX_DESCRIBED_SHARE = 0.02
#: Planes of two views are the same within this.
_SAME_TILT_RAD, _SAME_HEIGHT_M = math.radians(1.0), 0.06
#: So many pictures of a camera that has one view only must show the same plane, and this share of its points must be on it.
_MIN_PICTURES_OF_ONE_VIEW, _PLANE_SHARE_OF_ONE_VIEW = 3, 0.3
#: So many views, and half of the camera's, must show the same floor above the described one.
_MIN_HIGHER_VIEWS = 4

#: After so many comparisons no correction is looked for any more.
_MAX_COMPARED = 128
#: Of a correction, smaller turns and movements aren't told.
_SMALL_DEG, _SMALL_CM = 0.75, 7.5


@dataclass(slots=True)
class _Camera:
    """What the views of one camera showed.

    Attributes:
        descriptions: a hash of pose and lens, by view.
        mistakes: by view, the mistake that its newest picture shows; "" for none.
        planes: by view, the floor that its newest picture shows, where it shows one.
        n_refused: how many pictures showed a mistake.
        n_pictures: how many pictures showed a floor.
        place: where it stands by its description, and the altitude of its floor: (x, y, floor) [m, world]; () if unknown.
        points_cm: what it had measured when others looked through it [cm, world], as long as a correction is looked for.
        n_compared: how often it might have been compared with what others have measured since then.
        correction: by what its yaw [rad], x and y [m] must be changed; () if that isn't known.
        why: why the camera isn't believed; "" if it is.
    """

    descriptions: dict[int, str] = field(default_factory=dict)
    mistakes: dict[int, str] = field(default_factory=dict)
    planes: dict[int, FloorPlane] = field(default_factory=dict)
    n_refused: int = 0
    n_pictures: int = 0
    place: tuple[float, ...] = ()
    points_cm: list[list[int]] = field(default_factory=list)
    n_compared: int = 0
    correction: tuple[float, ...] = ()
    why: str = ""

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> _Camera:
        return cls(
            descriptions={int(view): text for view, text in state["descriptions"]},
            mistakes={int(view): text for view, text in state["mistakes"]},
            planes={int(view): FloorPlane(**fields) for view, fields in state["planes"]},
            # an earlier program's snapshot has none of these
            place=tuple(state.get("place", ())),
            points_cm=state.get("points_cm", []),
            n_compared=state.get("n_compared", 0),
            correction=tuple(state.get("correction", ())),
            **{name: state[name] for name in ("n_refused", "n_pictures", "why")},
        )

    def record_plane(self, view: int, plane: FloorPlane | None) -> None:
        """Records the floor that the newest picture of a view shows."""
        if plane is not None and plane.share >= _PLANE_SHARE and plane.spread_m >= _PLANE_SPREAD_M:
            self.planes[view] = plane
            self.n_pictures += 1
        else:
            self.planes.pop(view, None)

    def begin_fit(self, p_world: NDArray[np.float64]) -> None:
        """Keeps some of the points (N, 3) [m, world] that it has measured, so that a correction can be found."""
        if self.place:
            points = points_to_fit(p_world, np.array(self.place[:2]), self.place[2])
            self.points_cm = np.round(100.0 * points).astype(int).tolist()

    def try_to_fit(self, measured_by_others: Callable[[], NDArray[np.float64]]) -> None:
        """Compares what it has measured with what others have by now; adds the correction to why it isn't believed.

        That takes some tenths of a second, so it is done ever more seldom, and given up in the end.
        """
        if not self.points_cm:
            return
        self.n_compared += 1
        if self.n_compared & (self.n_compared - 1):  # no power of two
            return
        x_m, y_m, floor_z_m = self.place
        found = fit_pose(0.01 * np.array(self.points_cm), measured_by_others(), np.array([x_m, y_m]), floor_z_m)
        if found is not None and found.is_clear:
            self.why += f". {_correction_in_words(found, x_m, y_m)}"
            self.correction = found.yaw_rad, found.x_m, found.y_m
            self.points_cm = []
        elif self.n_compared >= _MAX_COMPARED:
            self.points_cm = []

    def state(self) -> dict[str, Any]:
        return {
            "descriptions": sorted(self.descriptions.items()),
            "mistakes": sorted(self.mistakes.items()),
            "planes": sorted((view, asdict(plane)) for view, plane in self.planes.items()),
            "place": list(self.place),
            "points_cm": self.points_cm,
            "n_compared": self.n_compared,
            "correction": list(self.correction),
            **{name: getattr(self, name) for name in ("n_refused", "n_pictures", "why")},
        }


class Quarantine:
    """Which cameras aren't believed, and why. ``frames``: which robots aren't, since they stand elsewhere than they say."""

    def __init__(self, config: ValidationConfig) -> None:
        self._config = config
        self.frames = RobotFrames(config.compare_every_views)
        self._excused: dict[str, int] = {}  # by camera, how many voxels a robot with a wrong frame has looked through
        self._cameras: dict[str, _Camera] = {}
        self._n_robot_views = 0  # since agreement was compared last

    def check(self, view: PosedView, cloud: VoxelCloud | None = None) -> None:
        """Records what a new view shows of the floor that it must see. ``cloud``: of its floor, if there is one.

        Raises:
            ViewError: ``geometry_disagrees``, a mistake in its camera's description is found; ``quarantined``: one was found in
                other views of its camera; ``frame_disagrees``, its robot isn't where it says.
        """
        if view.is_robot:
            self.frames.check(view, cloud)
        if view.is_robot or view.depth_source != "sensor":
            return
        camera = self._camera_of(view)
        mistake = camera.mistakes[view.view] = find_mistake(view, self._config) or ""
        if camera.why and not mistake:
            raise ViewError("quarantined", f"this camera isn't believed: {camera.why}")
        camera.record_plane(view.view, fit_floor_plane(view) if self._config.floor_share else None)
        camera.n_refused += bool(mistake)
        n_wrong = sum(map(bool, camera.mistakes.values()))
        planes_disagree = _why_planes_disagree(camera, view.view, self._config)
        is_mistaken = (
            bool(mistake) and camera.n_refused >= _MIN_PICTURES and n_wrong >= _MIN_SHARE * len(camera.mistakes)
        )
        # in one view, another height looks like another focal length; that views agree on a floor tells them apart
        camera.why = camera.why or planes_disagree or (mistake if is_mistaken else "")
        if mistake or camera.why:
            raise ViewError("geometry_disagrees", mistake or camera.why)

    def record_robot_view(self, view: PosedView, cloud: VoxelCloud, validator: ViewValidator) -> None:
        """Records that a robot's view was integrated into a cloud. From time to time cameras are compared with others in it."""
        self.frames.record_view(view)
        self._n_robot_views += 1
        if self._n_robot_views >= self._config.compare_every_views:  # it costs some milliseconds
            self._n_robot_views = 0
            within_ns = round(1e9 * self._config.compare_within_s)
            agreement = cloud.agreement(validator.cameras_current_since_ns(), within_ns)
            n_wrong, accused = len(self.frames.problems()), ""
            self.frames.compare_doubtful(cloud, view.floor_z_m)
            if len(self.frames.problems()) == n_wrong:
                accused = self.record_agreement(
                    agreement, lambda suspects: self.frames.accused_of(suspects, cloud, view.floor_z_m)
                )
            if len(self.frames.problems()) > n_wrong:
                self._excused = {source: found.n_refuted for source, found in agreement.items()}
            if accused:
                self._cameras[accused].begin_fit(cloud.measured_by({accused}))
            for source, camera in sorted(self._cameras.items()):
                camera.try_to_fit(lambda source=source: cloud.measured_by_others(source))  # type: ignore[misc]

    def record_agreement(
        self, agreement: Mapping[str, Agreement], choose: Callable[[list[str]], str] = lambda suspects: suspects[0]
    ) -> str:
        """Compares cameras with others, by source. One at most is put into quarantine: it may make others look wrong.

        Args:
            choose: which of the cameras that others look through, worst first; "": none of them.

        Returns:
            The camera that was put into quarantine; "" if none was.
        """
        c, reasons, shares = self._config, self.reasons(), dict[str, float]()
        for source, found in agreement.items():
            n_refuted = max(0, found.n_refuted - self._excused.get(source, 0))
            share = replace(found, n_refuted=n_refuted).refuted_share
            is_wrong = n_refuted >= c.min_refuted_voxels and share >= c.max_refuted_share
            if source.startswith("camera/") and is_wrong and source not in reasons:
                shares[source] = share
        if not shares:
            return ""
        source = choose(sorted(shares, key=lambda source: (shares[source], source), reverse=True))
        if source:
            self._cameras.setdefault(source, _Camera()).why = (
                f"others look through {100 * shares[source]:.0f} % of what it has measured where both have looked: its position "
                "or its direction is wrong, or it isn't this camera"
            )
        return source

    def reasons(self) -> dict[str, str]:
        """By source, why a camera isn't believed."""
        return {source: camera.why for source, camera in self._cameras.items() if camera.why}

    def corrections(self) -> dict[str, tuple[float, ...]]:
        """By source, by what a camera's yaw [rad], x and y [m] must be changed, where that was found."""
        return {source: camera.correction for source, camera in self._cameras.items() if camera.correction}

    def forget(self, source: str) -> None:
        """Forgets what the views of a camera or robot have shown, so that it is believed until they show it again."""
        self._cameras.pop(source, None)
        self._excused.pop(source, None)
        self.frames.forget(source)

    def state_of(self, source: str) -> dict[str, Any] | None:
        """What is known of a camera, for ``adopt``; None if nothing is."""
        camera = self._cameras.get(source)
        return camera.state() if camera else None

    def adopt(self, source: str, state: Mapping[str, Any]) -> None:
        """Takes over what another quarantine knew of a camera."""
        self._cameras[source] = _Camera.from_state(state)

    def state(self) -> dict[str, Any]:
        """Everything as plain values, for ``from_state``."""
        cameras = [[source, camera.state()] for source, camera in sorted(self._cameras.items())]
        return {
            "cameras": cameras,
            "n_robot_views": self._n_robot_views,
            "frames": self.frames.state(),
            "excused": sorted(self._excused.items()),
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any], config: ValidationConfig) -> Quarantine:
        quarantine = cls(config)
        quarantine._cameras = {source: _Camera.from_state(camera) for source, camera in state["cameras"]}
        quarantine._n_robot_views = state["n_robot_views"]
        if "frames" in state:  # an earlier program's snapshot has none
            quarantine.frames.adopt(state["frames"])
            quarantine._excused = dict(state["excused"])
        return quarantine

    def _camera_of(self, view: PosedView) -> _Camera:
        """What is known of a view's camera: nothing if it is described anew."""
        camera = self._cameras.setdefault(view.source, _Camera())
        text = view.T_world_camera.tobytes() + repr((view.camera, view.mounting_offset_m)).encode()
        description = hashlib.blake2b(text, digest_size=8).hexdigest()
        if camera.descriptions.setdefault(view.view, description) != description:  # it was calibrated anew
            self.forget(view.source)
            camera = self._cameras[view.source] = _Camera({view.view: description})
        camera.place = (float(view.T_world_camera[0, 3]), float(view.T_world_camera[1, 3]), float(view.floor_z_m))
        return camera


def _why_planes_disagree(camera: _Camera, view: int, config: ValidationConfig) -> str:
    """Why the floor that a camera's views show can't be the described one; "" if it can."""
    plane = camera.planes.get(view)
    if plane is None or not _is_another_floor(plane, config):
        return ""
    n_same = sum(_is_same(p, plane) for p in camera.planes.values())
    if len(camera.descriptions) == 1:
        enough = camera.n_pictures >= _MIN_PICTURES_OF_ONE_VIEW and plane.share >= _PLANE_SHARE_OF_ONE_VIEW
    elif plane.height_error_m > config.max_height_error_m:  # it may be a table that fills some of the views
        enough = n_same >= _MIN_HIGHER_VIEWS and 2 * n_same >= len(camera.descriptions)
    else:
        enough = n_same >= _MIN_PICTURES and 2 * n_same >= len(camera.planes)
    return _in_words(plane, config) if enough else ""


def _in_words(plane: FloorPlane, config: ValidationConfig) -> str:
    tilt_deg = math.degrees(plane.tilt_rad)
    height_cm = 100.0 * plane.height_error_m
    if abs(plane.height_error_m) > config.max_height_error_m:
        lower = "lower" if height_cm > 0 else "higher"
        return f"by the floor that it sees, it hangs {abs(height_cm):.0f} cm {lower} than stated"
    towards_deg = math.degrees(math.atan2(plane.tilt_y_rad, plane.tilt_x_rad)) % 360
    return (
        f"it leans otherwise than stated: the floor that it sees would rise by {tilt_deg:.1f} degrees towards "
        f"{towards_deg:.0f} degrees (0: the building's x axis)"
    )


def _correction_in_words(found: PoseCorrection, x_m: float, y_m: float) -> str:
    yaw_deg, moved_cm = math.degrees(found.yaw_rad), 100.0 * math.hypot(found.x_m, found.y_m)
    turn = f"if its yaw is {abs(yaw_deg):.1f} degrees {'more' if yaw_deg > 0 else 'less'} than stated"
    place = f"at ({x_m + found.x_m:.2f}, {y_m + found.y_m:.2f}) m, {moved_cm:.0f} cm from where it is stated"
    if abs(yaw_deg) < _SMALL_DEG:
        return f"It fits what others have measured if it stands {place}"
    if moved_cm < _SMALL_CM:
        return f"It fits what others have measured {turn}"
    return f"It fits what others have measured {turn} and it stands {place}"


def _is_another_floor(plane: FloorPlane, config: ValidationConfig) -> bool:
    if abs(plane.height_error_m) > config.max_height_error_m:
        return plane.described_share < _MAX_DESCRIBED_SHARE
    return plane.tilt_rad > math.radians(config.max_tilt_deg)


def _is_same(one: FloorPlane, other: FloorPlane) -> bool:
    tilt_rad = math.hypot(one.tilt_x_rad - other.tilt_x_rad, one.tilt_y_rad - other.tilt_y_rad)
    return tilt_rad < _SAME_TILT_RAD and abs(one.height_error_m - other.height_error_m) < _SAME_HEIGHT_M
