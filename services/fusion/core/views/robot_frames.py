"""Robots whose frame is wrong: they aren't where they say, so none of their views is believed while it is so.

A robot that is off looks through what cameras have measured, just as if a camera were described wrongly. So before a camera is
accused, what the robot has seen lately is matched with what each camera nearby has measured (``pose_fit``). It is, too, where
much of it lies at no place that cameras have measured, although they have measured around it. Which of both is wrong then
follows from the corrections that several cameras ask for (``surveilnav.robot_frame.drift``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.robot_frame.drift import DriftMonitor
from surveilnav.robot_frame.planar import PlanarTransform
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core.maps.cloud import VoxelCloud
from surveilnav.services.fusion.core.views.frame_answers import add_coinciding, add_correction, add_tested
from surveilnav.services.fusion.core.views.pose_fit import fit_pose, points_to_fit
from surveilnav.services.fusion.core.views.validation import ViewError

#: What a robot has seen lately are so many views, each taken so far from the last one or turned so far.
_MAX_KEPT, _MIN_KEPT, _STEP_M, _STEP_RAD = 12, 4, 0.2, math.radians(15.0)
#: Of each view, so many places across are sampled, up to so far.
_SAMPLES, _MAX_OF_VIEW, _MIN_RANGE_M, _MAX_RANGE_M = 40, 200, 0.05, 5.0
#: Points are compared with a camera that has measured something so near, if so many are. At most so many cameras are asked.
_NEAR_M, _MIN_NEAR, _MAX_ASKED = 0.6, 300, 4
#: Twelve views that follow each other don't reach farther than this, or the robot isn't believed to have seen them.
_MAX_SEEN_M = 100.0
#: One camera's correction is tested with so many others.
_MAX_TESTED = 12
#: A robot is compared if a smaller share of its points lies in such a cell that cameras have measured, or beside one. It is 0.98
#: and more of healthy robots, and 0.5 to 0.85 of one that is off by 0.5 m.
_CELL_M, _MIN_SHARE = 0.1, 0.9
#: A camera that is accused waits for so many comparisons for a second camera to tell whether the robot is to blame.
_MAX_WAITING = 8
_CLIMB_M, _MAX_ROBOTS = 0.4, 64
_Points = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FrameProblem:
    """A robot's frame is wrong.

    Attributes:
        why: what is wrong and what to do, for people.
        correction: takes a point as the robot reports it to where the cameras have measured it.
        dx_m, dy_m, dyaw_rad: how the robot must be moved and turned from the pose that it reports.
    """

    why: str
    correction: PlanarTransform
    dx_m: float
    dy_m: float
    dyaw_rad: float


@dataclass(slots=True)
class _Robot:
    """What a robot has seen lately: some points of each view [cm, building as it says], and where it was: x, y, yaw, floor."""

    monitor: DriftMonitor = field(default_factory=DriftMonitor)
    places: list[tuple[float, float, float, float]] = field(default_factory=list)
    points_cm: list[NDArray[np.int32]] = field(default_factory=list)
    seq: int = -1
    n_refused: int = 0
    n_doubted: int = 0
    is_compared: bool = False  # in this round

    @property
    def p(self) -> _Points:
        return np.array(self.places[-1][:2])

    def record(self, view: PosedView) -> None:
        """Keeps some points of a view, if it was taken elsewhere than the last one."""
        if view.seq < self.seq:  # it began anew, perhaps with another frame
            self._restart()
        self.seq = view.seq
        T = view.T_world_camera
        place = float(T[0, 3]), float(T[1, 3]), math.atan2(T[1, 2], T[0, 2]), view.floor_z_m
        if self.places:
            x, y, yaw, floor_z_m = self.places[-1]
            if abs(floor_z_m - place[3]) > _CLIMB_M:
                self._restart()
            elif math.dist((x, y), place[:2]) < _STEP_M and abs(math.remainder(yaw - place[2], math.tau)) < _STEP_RAD:
                return
        self.places = [*self.places, place][-_MAX_KEPT:]
        self.points_cm = [*self.points_cm, _sampled_cm(view)][-_MAX_KEPT:]

    def _restart(self) -> None:
        self.places, self.points_cm = [], []
        self.monitor.restart()

    def points(self) -> _Points:
        """(N, 3) of what it has seen lately [m, building as it says]; none as long as that is little."""
        if len(self.places) < _MIN_KEPT:
            return np.empty((0, 3))
        points = np.asarray(0.01 * np.concatenate(self.points_cm), np.float64)
        return points_to_fit(points, self.p, self.places[-1][3])

    def is_doubtful(self, measured: _Points) -> bool:
        """Whether it should be compared: it doubts less and less often if nothing comes of it.

        Args:
            measured: (M, 3) what cameras have measured [m, building].
        """
        points = self.points()
        near = points[_is_near(points, measured)]
        if len(near) < _MIN_NEAR or _share_beside(near, measured) >= _MIN_SHARE:
            self.n_doubted = 0
            return False
        self.n_doubted += 1
        return not self.n_doubted & (self.n_doubted - 1)  # a power of two

    def compare(self, cloud: VoxelCloud, cameras: set[str]) -> None:
        """Compares what it has seen lately with what cameras have measured."""
        mine = self.points()
        if not len(mine):
            return
        floor_z_m = self.places[-1][3]
        overlaps = []
        for camera in sorted(cameras):
            others = cloud.measured_by({camera})
            near = mine[_is_near(mine, others)]
            if len(near) >= _MIN_NEAR:
                overlaps.append((-len(near), camera, near, others))
        overlaps.sort(key=lambda found: found[:2])
        answers: dict[str, PlanarTransform | None] = {}
        unclear: dict[str, PlanarTransform] = {}
        for _, camera, near, others in overlaps[:_MAX_ASKED]:
            found = fit_pose(near, others, self.p, floor_z_m)
            if found is not None:
                add_correction(answers, unclear, camera, found, self.p)
        add_coinciding(answers, unclear, self.p)
        # One camera's correction is tested with the others: that takes weaker evidence than finding it does.
        by, hypothesis = self._hypothesis(answers)
        if hypothesis is not None:
            for _, camera, near, others in overlaps[:_MAX_TESTED]:
                if camera != by and camera not in answers:
                    add_tested(answers, camera, hypothesis, near, others, self.places[-1])
        self.monitor.record(answers, self.p)

    def _hypothesis(self, answers: Mapping[str, PlanarTransform | None]) -> tuple[str, PlanarTransform | None]:
        """A camera that asks for a correction, and the correction: now or, if none does, one from earlier comparisons."""
        now = [(camera, T) for camera, T in answers.items() if T is not None]
        before = [(camera, T) for camera, T in sorted(self.monitor.corrections.items()) if camera not in answers]
        return next(iter(now + before), ("", self.monitor.correction))

    def state(self) -> dict[str, Any]:
        return {
            "monitor": self.monitor.state(),
            "places": [list(place) for place in self.places],
            "points_cm": list(self.points_cm),
            "seq": self.seq,
            "n_refused": self.n_refused,
            "n_doubted": self.n_doubted,
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> _Robot:
        return cls(
            DriftMonitor.from_state(state["monitor"]),
            [(x, y, yaw, z) for x, y, yaw, z in state["places"]],
            [np.array(points, np.int32).reshape(-1, 3) for points in state["points_cm"]],
            state["seq"],
            state["n_refused"],
            state["n_doubted"],
        )


class RobotFrames:
    """Which robots' frames are wrong, and what they have seen lately. ``compare_every``: views between two comparisons."""

    def __init__(self, compare_every: int) -> None:
        self._compare_every = compare_every
        self._robots: dict[str, _Robot] = {}
        self._waiting: dict[str, int] = {}  # how many comparisons a camera waits already

    def problems(self) -> dict[str, FrameProblem]:
        """By source, what is wrong with a robot's frame."""
        return {
            source: _problem(source, robot)
            for source, robot in sorted(self._robots.items())
            if robot.monitor.correction is not None
        }

    def check(self, view: PosedView, cloud: VoxelCloud | None) -> None:
        """Looks whether a robot whose frame was wrong agrees with the cameras again. Raises ViewError: it doesn't."""
        robot = self._robots.get(view.source)
        if robot is None or robot.monitor.correction is None:
            return
        if view.depth_source == "sensor":
            robot.record(view)
        robot.n_refused += 1
        if cloud is not None and robot.n_refused % self._compare_every == 0:
            robot.compare(cloud, _cameras_of(cloud))
        if robot.monitor.correction is not None:
            raise ViewError("frame_disagrees", _problem(view.source, robot).why)
        robot.n_refused = 0

    def record_view(self, view: PosedView) -> None:
        """Records a robot's view that was integrated."""
        if view.depth_source != "sensor" or (view.source not in self._robots and len(self._robots) >= _MAX_ROBOTS):
            return
        self._robots.setdefault(view.source, _Robot()).record(view)

    def compare_doubtful(self, cloud: VoxelCloud, floor_z_m: float) -> None:
        """Compares the robots of a floor of which much that they have seen lately was seen by no camera."""
        cameras = _cameras_of(cloud)
        if len(cameras) > 1 and (here := self._on(floor_z_m)):
            measured = cloud.measured_by(cameras)
            for robot in here:
                robot.is_compared = robot.is_doubtful(measured)
                if robot.is_compared:
                    robot.compare(cloud, cameras)

    def _on(self, floor_z_m: float) -> list[_Robot]:
        robots = (robot for _, robot in sorted(self._robots.items()))
        return [robot for robot in robots if robot.places and abs(robot.places[-1][3] - floor_z_m) <= _CLIMB_M]

    def accused_of(self, suspects: list[str], cloud: VoxelCloud, floor_z_m: float) -> str:
        """Which camera is wrong, of those that robots look through, worst first. "": it can't be told yet, or a robot is."""
        cameras, n_wrong, here = _cameras_of(cloud), len(self.problems()), self._on(floor_z_m)
        if len(cameras) > 1:
            for robot in here:
                if not robot.is_compared:
                    robot.compare(cloud, cameras)
        if len(self.problems()) > n_wrong:
            self._waiting.clear()
            return ""
        self._waiting = {camera: self._waiting.get(camera, 0) + 1 for camera in suspects}
        for camera in suspects:
            if (
                len(cameras) == 1  # there is nobody to tell, and a robot needs its own views more than a camera's
                or any(robot.monitor.is_contradicted_by(camera, robot.p) for robot in here)
                or self._waiting[camera] > _MAX_WAITING
            ):
                del self._waiting[camera]
                return camera
        return ""

    def forget(self, source: str) -> None:
        """Forgets a camera's answers, since it is another one now, or all that is known of a robot."""
        self._robots.pop(source, None)
        self._waiting.pop(source, None)
        for robot in self._robots.values():
            robot.monitor.forget(source)

    def state(self) -> dict[str, Any]:
        """Everything as plain arrays and values, for ``adopt``."""
        return {
            "robots": [[source, robot.state()] for source, robot in sorted(self._robots.items())],
            "waiting": sorted(self._waiting.items()),
        }

    def adopt(self, state: Mapping[str, Any]) -> None:
        """Takes over what ``state`` returned."""
        self._robots = {source: _Robot.from_state(robot) for source, robot in state["robots"]}
        self._waiting = dict(state["waiting"])


def _sampled_cm(view: PosedView) -> NDArray[np.int32]:
    """(n, 3) of a view's points at heights that are compared [cm, world], rounded."""
    step = max(1, view.camera.width_px // _SAMPLES)
    depth_m = view.depth_m[::step, ::step]
    c, (height, width) = view.camera, depth_m.shape
    lens = Pinhole(width, height, c.fx_px / step, c.fy_px / step, c.cx_px / step, c.cy_px / step)
    seen = (depth_m > _MIN_RANGE_M) & (depth_m < _MAX_RANGE_M)
    p_camera = lens.rays()[seen] * depth_m[seen][:, None]
    p_world = p_camera @ view.T_world_camera[:3, :3].T + view.T_world_camera[:3, 3]
    points = points_to_fit(p_world, view.T_world_camera[:2, 3], view.floor_z_m, _MAX_OF_VIEW)
    chosen: NDArray[np.int32] = np.round(100.0 * points).astype(np.int32)
    return chosen


def _is_near(points: _Points, others: _Points) -> NDArray[np.bool_]:
    """Which of the points (N, 3) lie in the plane within ``_NEAR_M`` of others (M, 3)."""
    if not len(points):
        return np.zeros(0, np.bool_)
    low, high = points[:, :2].min(axis=0) - 2 * _NEAR_M, points[:, :2].max(axis=0) + 2 * _NEAR_M
    # a robot may say that it is anywhere: the grid is no larger than what it has seen
    others = others[((others[:, :2] >= low + _NEAR_M) & (others[:, :2] <= high - _NEAR_M)).all(axis=1)]
    if not len(others) or (high - low).max() > _MAX_SEEN_M:
        return np.zeros(len(points), np.bool_)
    cells, of_others = (np.floor((p[:, :2] - low) / _NEAR_M).astype(np.int64) for p in (points, others))
    shape = np.maximum(cells.max(axis=0), of_others.max(axis=0)) + 2
    there = np.zeros(shape, np.bool_)
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            there[of_others[:, 0] + i, of_others[:, 1] + j] = True
    return np.asarray(there[cells[:, 0], cells[:, 1]])


def _share_beside(points: _Points, others: _Points) -> float:
    """The share of points (N, 3) that lie in a cell with others (M, 3), or beside one."""
    low = points.min(axis=0) - 2 * _CELL_M
    shape = np.floor((points.max(axis=0) - low) / _CELL_M).astype(np.int64) + 3
    cells = np.floor((others - low) / _CELL_M).astype(np.int64)
    cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    there = np.zeros(shape, np.bool_)
    there[tuple(cells.T)] = True
    for axis in range(3):
        grown = np.moveaxis(there.copy(), axis, 0)
        was = np.moveaxis(there, axis, 0)
        grown[1:] |= was[:-1]
        grown[:-1] |= was[1:]
        there = np.moveaxis(grown, 0, axis)
    return float(there[tuple(np.floor((points - low) / _CELL_M).astype(np.int64).T)].mean())


def _cameras_of(cloud: VoxelCloud) -> set[str]:
    return {name for members in cloud.source_sets() for name in members if name.startswith("camera/")}


def _problem(source: str, robot: _Robot) -> FrameProblem:
    T, p = robot.monitor.correction, robot.p
    assert T is not None
    dx_m, dy_m = (T.apply(p) - p).tolist()
    names = " and ".join(name.partition("/")[2] for name in robot.monitor.witnesses)
    id = source.partition("/")[2]
    why = (
        f"robot {id} isn't where it says: what it sees fits what cameras {names} have measured if it is moved by "
        f"({dx_m:+.2f}, {dy_m:+.2f}) m and turned by {math.degrees(T.yaw_rad):+.1f} degrees. Its frame T_building_map or its "
        "localisation is wrong: find it anew (`surveilnav robots frame`). What it saw before is perhaps in the maps: "
        f"`surveilnav robots remove {id} --from-maps` takes it out"
    )
    return FrameProblem(why, T, dx_m, dy_m, T.yaw_rad)
