"""Where cameras hang and look, and where the tag sits on the robot, from all sightings of the tag together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.estimated_pose import EstimatedPose
from surveilnav.camera_pose.tag.adjustment import adjust, covariance
from surveilnav.camera_pose.tag.geometry_of_stops import fault_of_stops
from surveilnav.camera_pose.tag.model import CAMERA_DOF, Observations, State, linearise, squared_distances
from surveilnav.camera_pose.tag.sightings import Sightings
from surveilnav.camera_pose.tag.start import CLIPPED_D2, camera_from_tag, first_state, settled
from surveilnav.errors import PoseError
from surveilnav.geometry import Matrix4
from surveilnav.geometry.lens import Lens

#: Stops at which a camera has to see the tag. With fewer, nothing tells a wrong one from the right ones.
MIN_STOPS = 5
_MIN_AGREEING_SHARE = 0.6
#: Squared distance up to which a sighting agrees, of 8 degrees of freedom: of right ones one in 10,000 is beyond it.
_AGREES_D2 = 32.0
#: Standard deviation of the position [m] from which a pose is of no use.
_MAX_SIGMA_M = 0.5
_FIRST_CAMERAS = 3  # by which the tag's place on the robot is looked for


@dataclass(frozen=True, eq=False)
class TagCamera(EstimatedPose):
    """The pose of a camera that the tag was carried past.

    Attributes:
        stops: numbers of the stops that its pose follows from.
        residual_px: root mean square distance of a corner from its prediction.
    """

    stops: tuple[int, ...]
    residual_px: float


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A sighting that contradicts the others: the robot would have to be ``off_m`` and ``off_rad`` from where it said it was."""

    camera: str
    stop: int
    off_m: float
    off_rad: float


@dataclass(frozen=True, eq=False)
class TagFit:
    """What all sightings give.

    Attributes:
        cameras: by name, those whose pose could be found.
        refused: by name, why the pose of another camera couldn't.
        T_robot_tag: (4, 4), where the tag sits on the robot.
        left_out: sightings that didn't count, by stop.
    """

    cameras: dict[str, TagCamera]
    refused: dict[str, str] = field(default_factory=dict)
    T_robot_tag: Matrix4 = field(default_factory=lambda: np.eye(4))
    left_out: tuple[LeftOut, ...] = ()


def solve_tag(
    lenses: Mapping[str, Lens],
    sightings: Sightings,
    floor_z_m: Mapping[str, float],
    sigma_px: float = 0.5,
    sigma_robot_m: float = 0.02,
    sigma_robot_rad: float = math.radians(1.0),
) -> TagFit:
    """The poses of all cameras that saw the tag often enough.

    Args:
        lenses: by camera.
        floor_z_m: altitude by floor.
        sigma_px: standard deviation of u and of v of a corner.
        sigma_robot_m, sigma_robot_rad: of the robot's x and y, and of its yaw.

    Raises:
        PoseError: no camera's pose can be found; the text says for each what is missing.
    """
    refused: dict[str, str] = {}
    names = []
    for name, lens in lenses.items():
        n = sightings.count(name)
        if n < MIN_STOPS:
            refused[name] = f"saw the tag at {n} stop{'' if n == 1 else 's'}: {MIN_STOPS} are needed"
        elif fault := fault_of_lens(lens, sightings, name):
            refused[name] = fault
        else:
            names.append(name)
    while names:
        seen = observations(
            names, lenses, sightings, floor_z_m, sigma_px, (sigma_robot_m, sigma_robot_m, sigma_robot_rad)
        )
        rough = _rough(seen)
        if rough is None:
            refused |= {name: _nothing_fits(seen, camera) for camera, name in enumerate(names)}
            break
        faulty, state, agree = _solved(seen, rough)
        if not faulty:
            faulty = _undetermined(state, seen[agree])
        if not faulty:
            return _fit(names, seen, state, agree, refused)
        refused |= {names[camera]: fault for camera, fault in faulty.items()}
        names = [name for camera, name in enumerate(names) if camera not in faulty]
    raise PoseError(
        "no camera's pose can be found:\n" + "\n".join(f"{name} {why}" for name, why in refused.items())
        if refused
        else "there are no cameras"
    )


def fault_of_lens(lens: Lens, sightings: Sightings, camera: str) -> str:
    """Why a camera's lens can't have made its sightings; empty: it can."""
    width, height = lens.pinhole.width_px, lens.pinhole.height_px
    for number, stop in enumerate(sightings.stops, start=1):
        corners = stop.seen.get(camera)
        if corners is None:
            continue
        if (corners < -0.5).any() or (corners > np.array([width, height]) - 0.5).any():
            return (
                f"saw the tag at stop {number} outside the picture of {width} x {height} pixels that its lens is given for; "
                "has its stream another size, or had it when the sightings were made?"
            )
        if not np.isfinite(lens.rays(corners)).all():
            return f"saw the tag at stop {number} where its lens sees nothing: check the lens in the file of cameras"
    return ""


def observations(
    names: list[str],
    lenses: Mapping[str, Lens],
    sightings: Sightings,
    floor_z_m: Mapping[str, float],
    sigma_px: float,
    sigma_stop: tuple[float, float, float],
) -> Observations:
    """The sightings of some cameras. All stops are there, so that their numbers stay, also those that none of the cameras saw."""
    rows = [
        (camera, stop, entry.seen[name])
        for stop, entry in enumerate(sightings.stops)
        for camera, name in enumerate(names)
        if name in entry.seen
    ]
    return Observations(
        tuple(lenses[name] for name in names),
        np.array([row[0] for row in rows]),
        np.array([row[1] for row in rows]),
        np.array([row[2] for row in rows], np.float64),
        np.array([(stop.x_m, stop.y_m, stop.yaw_rad) for stop in sightings.stops]),
        np.array([floor_z_m[stop.floor] for stop in sightings.stops]),
        sightings.tag.size_m,
        sightings.tag.height_m,
        sigma_px,
        sigma_stop,
    )


def _solved(seen: Observations, state: State) -> tuple[dict[int, str], State, NDArray[np.bool_]]:
    """From a rough state: cameras whose sightings contradict each other and why, the state, and the (n,) bool of what agrees."""
    n = np.bincount(seen.camera, minlength=len(seen.lenses))
    agree = squared_distances(state, seen) < _AGREES_D2
    for _ in range(8):
        n_agree = np.bincount(seen.camera[agree], minlength=len(seen.lenses))
        few = np.nonzero((n_agree < MIN_STOPS) | (n_agree < _MIN_AGREEING_SHARE * n))[0]
        if len(few):
            return {int(camera): _contradiction(n_agree[camera], n[camera]) for camera in few}, state, agree
        fit = adjust(replace(state, stops=seen.stops), seen[agree], robust=False)
        if fit is None:
            break
        state = fit.state
        again = squared_distances(state, seen) < _AGREES_D2
        if (again == agree).all():
            break
        agree = again
    return {}, state, agree


def _contradiction(n_agree: int, n: int) -> str:
    return (
        f"saw the tag at {n} stops, which contradict each other: only {n_agree} agree, and {MIN_STOPS} are needed. Check its "
        "lens, the tag's size and height, and whether the robot knows where it is; or make more stops"
    )


def _nothing_fits(seen: Observations, camera: int) -> str:
    own = seen.stops[np.unique(seen.stop[seen.camera == camera])]
    if np.ptp(own[:, :2], axis=0).max() < 1e-6:  # no line between two of them
        return f"could be anywhere: {fault_of_stops(own, own)}"
    return "saw nothing that fits the robot's poses: check the tag's size, the lens, and whether the robot knows where it is"


def _rough(seen: Observations) -> State | None:
    """A state near the minimum: the tag's place from one camera, by it the others, then all together."""
    most = np.argsort(-np.bincount(seen.camera, minlength=len(seen.lenses)), kind="stable")[:_FIRST_CAMERAS]
    best, best_cost = None, math.inf
    for first in most:
        own = seen.of_camera(int(first))
        start = first_state(own)
        if start is None:
            continue
        state = _with_others(seen, int(first), start.state)
        fit = settled(state, seen) if state is not None else None
        if fit is None:
            continue
        cost = np.minimum(squared_distances(fit.state, seen), CLIPPED_D2).sum()
        if cost < best_cost:
            best, best_cost = fit.state, float(cost)
    return best


def _with_others(seen: Observations, first: int, state: State) -> State | None:
    """The state of all cameras, from that of one."""
    cameras = []
    for camera in range(len(seen.lenses)):
        T = state.T_world_camera[0] if camera == first else camera_from_tag(seen.of_camera(camera), state.T_robot_tag)
        if T is None:
            return None
        cameras.append(T)
    return State(np.stack(cameras), state.T_robot_tag, seen.stops)


def _undetermined(state: State, seen: Observations) -> dict[int, str]:
    """Cameras whose position stays open, and what is missing."""
    sigmas = _covariance(state, seen)
    faulty = {}
    for camera in range(len(seen.lenses)):
        block = slice(CAMERA_DOF * camera, CAMERA_DOF * camera + 3)
        sigma_m = math.sqrt(np.trace(sigmas[block, block]))
        if not sigma_m < _MAX_SIGMA_M:
            own = np.unique(seen.stop[seen.camera == camera])
            how = f"is uncertain by ± {sigma_m:.1f} m" if math.isfinite(sigma_m) else "could be anywhere"
            every = np.unique(seen.stop)
            faulty[camera] = f"{how}: {fault_of_stops(seen.stops[own], seen.stops[every])}"
    return faulty


def _covariance(state: State, seen: Observations) -> NDArray[np.float64]:
    """Of all unknowns; enlarged if the sightings fit worse than their assumed errors allow."""
    at = linearise(state, seen)
    moved = (seen.stops - state.stops) / seen.sigma_stop
    # A stop has as many measurements of its own as unknowns, so it adds nothing to the degrees of freedom.
    dof = 8 * len(seen) - CAMERA_DOF * len(seen.lenses) - 5
    inflation = max(1.0, float(np.square(at.residuals).sum() + np.square(moved).sum()) / dof)
    return covariance(state, seen) * inflation


def _fit(
    names: list[str], seen: Observations, state: State, agree: NDArray[np.bool_], refused: dict[str, str]
) -> TagFit:
    used = seen[agree]
    sigmas, residuals = _covariance(state, used), linearise(state, used).residuals * seen.sigma_px
    cameras = {}
    for camera, name in enumerate(names):
        own = used.camera == camera
        block = slice(CAMERA_DOF * camera, CAMERA_DOF * (camera + 1))
        cameras[name] = TagCamera(
            state.T_world_camera[camera],
            sigmas[block, block],
            tuple(int(stop) + 1 for stop in used.stop[own]),
            math.sqrt(2 * float(np.square(residuals[own]).mean())),
        )
    others = seen[~agree]
    off = stops_off(state, others)
    left_out = tuple(
        LeftOut(names[camera], int(stop) + 1, float(np.hypot(*moved[:2])), float(abs(moved[2])))
        for camera, stop, moved in zip(others.camera, others.stop, off, strict=True)
    )
    return TagFit(cameras, refused, state.T_robot_tag, left_out)


def stops_off(state: State, seen: Observations) -> NDArray[np.float64]:
    """(n, 3): how far the robot would have to be from where it said, for each sighting by itself: x, y [m] and yaw [rad]."""
    at = linearise(replace(state, stops=seen.stops), seen)
    off = np.full((len(seen), 3), np.nan)
    for i in np.nonzero(at.visible)[0]:
        off[i] = np.linalg.lstsq(at.by_stop[i], at.residuals[i], rcond=None)[0]
    return off
