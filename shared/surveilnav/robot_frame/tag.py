"""A robot's frame from an AprilTag on the robot, which cameras see whose poses are known, while the robot says where it stands.

It is the calibration of cameras by a tag (``camera_pose.tag``) the other way round: the cameras' poses are known, and the robot's
frame is looked for. Unknown are the transform (x, y, yaw) and the tag's place on the robot (x, y and a rotation). Where the tag
is follows from one sighting well, its direction badly. So a start comes from the places alone: with q = R t,

    p_building = R p_map + R_yaw q + s        (R_yaw: the robot's direction in its map; t: the tag's place on the robot)

is linear in (cos, sin) of R, in q and in s. The best of many such starts, each from three sightings, is adjusted by least squares
on all corners that agree, in which the robot may stand beside where it says.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from surveilnav.camera_pose.tag.model import Observations, State, linearise, squared_distances
from surveilnav.camera_pose.tag.sightings import Sightings
from surveilnav.camera_pose.tag.solve import LeftOut, fault_of_lens, observations, stops_off
from surveilnav.camera_pose.tag.start import TagPoses, mounting
from surveilnav.errors import FrameError
from surveilnav.geometry import Matrix4
from surveilnav.geometry.lens import Lens
from surveilnav.robot_frame.found_frame import FoundFrame, in_words, listed
from surveilnav.robot_frame.planar import PlanarTransform

_Array = NDArray[np.float64]
MIN_STOPS = 4
_STARTS, _REFINED, _STEPS = 400, 4, 30
#: Errors of a start's places [m]; a tag sits within so much of the robot's centre.
_START_SIGMA_M, _TAG_SIGMA_M = 0.15, 0.3
#: Squared distance up to which a sighting agrees, of 8 degrees of freedom, and the share of sightings that must.
_AGREES_D2, _MIN_AGREEING = 32.0, 0.6
#: Of the frame, at the stops; beyond it is of no use.
_MAX_SIGMA_M, _MAX_SIGMA_RAD = 0.15, math.radians(2.0)
#: Errors of the first adjustments, in those of the last; and from which squared distance on a sighting loses weight in them.
_LOOSENED, _HALF_D2 = (4.0, 2.0, 1.0, 1.0, 1.0), 16.0
_N = 8  # unknowns: frame (x, y, yaw), tag (x, y, rotation)


def from_tag(
    sightings: Sightings,
    lenses: Mapping[str, Lens],
    T_world_camera: Mapping[str, Matrix4],
    floor_z_m: Mapping[str, float],
    sigma_px: float = 0.5,
    sigma_robot_m: float = 0.03,
    sigma_robot_rad: float = math.radians(1.5),
) -> FoundFrame:
    """``T_building_map`` by all sightings that agree. Those that don't are left out, and their stops are named.

    Args:
        sightings: their stops say where the robot stood in its map.
        lenses, T_world_camera: by camera; sightings by other cameras don't count.
        floor_z_m: altitude by floor.
        sigma_px: standard deviation of u and of v of a corner.
        sigma_robot_m, sigma_robot_rad: of the robot's x and y in its map, and of its yaw.

    Raises:
        FrameError: the sightings are too few, lie badly, or contradict each other.
    """
    names = sorted(lenses.keys() & T_world_camera.keys())
    for name in names:
        if fault := fault_of_lens(lenses[name], sightings, name):
            raise FrameError("contradictory", f"camera {name} {fault}")
    n_stops = sum(any(name in stop.seen for name in names) for stop in sightings.stops)
    if n_stops < MIN_STOPS:
        raise FrameError(
            "undetermined",
            f"cameras with a known pose saw the tag at {n_stops} stop{'' if n_stops == 1 else 's'}: {MIN_STOPS} are needed, "
            "better ten, in different places and directions",
        )
    sigma_stop = sigma_robot_m, sigma_robot_m, sigma_robot_rad
    seen = observations(names, lenses, sightings, floor_z_m, sigma_px, sigma_stop)
    cameras = np.stack([T_world_camera[name] for name in names])
    best = max((_adjusted(start, seen, cameras) for start in _starts(seen, cameras)), key=_rank, default=None)
    if best is None or best.agree.sum() < max(MIN_STOPS, _MIN_AGREEING * len(seen)):
        n = 0 if best is None else int(best.agree.sum())
        raise FrameError(
            "contradictory",
            f"of {len(seen)} sightings of the tag, only {n} agree on where the robot's map lies: check the cameras' poses, the "
            "tag's size and height, and whether the robot's localisation was right while it stopped"
            + _by_camera(best, seen, names),
        )
    return _found(best, seen, cameras, names)


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A frame and the tag's place on the robot; which sightings (n,) bool agree with it, and how badly these fit."""

    T_building_map: PlanarTransform
    T_robot_tag: Matrix4
    agree: NDArray[np.bool_]
    cost: float

    def state(self, seen: Observations, cameras: _Array) -> State:
        T = self.T_building_map
        stops = np.concatenate([T.apply(seen.stops[:, :2]), seen.stops[:, 2:] + T.yaw_rad], axis=1)
        return State(cameras, self.T_robot_tag, stops)


def _by_camera(best: _Fit | None, seen: Observations, names: list[str]) -> str:
    """How many sightings of each camera agree, if there are several cameras."""
    if best is None or len(names) < 2:
        return ""
    counts = [
        f"{int((best.agree & (seen.camera == k)).sum())} of {int((seen.camera == k).sum())} by {name}"
        for k, name in enumerate(names)
    ]
    return f". Those that agree: {', '.join(counts)}"


def _rank(fit: _Fit) -> tuple[int, float]:
    return int(fit.agree.sum()), -fit.cost


def _starts(seen: Observations, cameras: _Array) -> list[_Fit]:
    """Some frames that the places of many sightings fit, and the tag's direction that most of these agree on."""
    poses = TagPoses.from_sightings(seen)
    R_world_camera = cameras[seen.camera][:, :3, :3]
    p_building = np.einsum("nij,nj->ni", R_world_camera, poses.p_camera[:, 0]) + cameras[seen.camera][:, :3, 3]
    R_building_tag = R_world_camera[:, None] @ poses.R_camera_tag
    at = seen.stops[seen.stop]
    rng, ranked = np.random.default_rng(0), []
    for _ in range(_STARTS):
        chosen = rng.choice(len(seen), min(3, len(seen)), replace=False)
        T, tag_m = _fit_places(p_building[chosen, :2], at[chosen])
        off_m = np.linalg.norm(_places(T, tag_m, at) - p_building[:, :2], axis=1)
        ranked.append((float(np.minimum(1.0, (off_m / _START_SIGMA_M) ** 2).sum()), T, tag_m))
    ranked.sort(key=lambda start: start[0])
    out: list[_Fit] = []
    for _, T, tag_m in ranked:
        if len(out) == _REFINED:
            break
        if all(T.difference(other.T_building_map, at[0, :2])[0] > _START_SIGMA_M for other in out):
            turned = PlanarTransform(0.0, 0.0, T.yaw_rad)
            R_building_robot = np.array(
                [(turned @ PlanarTransform(0.0, 0.0, yaw)).matrix()[:3, :3] for yaw in at[:, 2]]
            )
            _, R_robot_tag = mounting(np.eye(3), R_building_robot, R_building_tag)
            T_robot_tag = np.eye(4)
            T_robot_tag[:3, :3], T_robot_tag[:3, 3] = R_robot_tag, (*tag_m, seen.height_m)
            out.append(_Fit(T, T_robot_tag, np.ones(len(seen), np.bool_), math.inf))
    return out


def _fit_places(p_building: _Array, at: _Array) -> tuple[PlanarTransform, _Array]:
    """The frame and the tag's place (2,) on the robot that places (n, 2) of the tag fit, by linear least squares.

    Args:
        at: (n, 3) x, y, yaw of the robot in its map.
    """
    p0, m0 = p_building.mean(axis=0), at[:, :2].mean(axis=0)
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    x, y = (at[:, :2] - m0).T
    one, zero = np.ones(len(at)), np.zeros(len(at))
    # unknowns: cos, sin of the frame; q; s
    A = np.concatenate(
        [np.stack([x, -y, c, -s, one, zero], axis=1), np.stack([y, x, s, c, zero, one], axis=1)]
    )  # rows of x, then of y
    prior = np.zeros((2, 6))
    prior[0, 2] = prior[1, 3] = (
        _START_SIGMA_M / _TAG_SIGMA_M
    )  # where all directions are alike, q and s can't be told apart
    solved = np.linalg.lstsq(
        np.concatenate([A, prior]), np.concatenate([*(p_building - p0).T, [0.0, 0.0]]), rcond=None
    )[0]
    yaw_rad = math.atan2(solved[1], solved[0])
    turn = PlanarTransform(0.0, 0.0, yaw_rad)
    shift = p0 + solved[4:] - turn.apply(m0)
    return PlanarTransform(float(shift[0]), float(shift[1]), yaw_rad), turn.inverse().apply(solved[2:4])


def _places(T: PlanarTransform, tag_m: _Array, at: _Array) -> _Array:
    """(n, 2) where the tag is in the building, while the robot is at (n, 3) in its map."""
    c, s = np.cos(at[:, 2]), np.sin(at[:, 2])
    tag = np.stack([c * tag_m[0] - s * tag_m[1], s * tag_m[0] + c * tag_m[1]], axis=1)
    return T.apply(at[:, :2] + tag)


def _adjusted(fit: _Fit, seen: Observations, cameras: _Array) -> _Fit:
    """The next minimum, by Gauss and Newton, from all sightings that agree; with large errors at first."""
    for factor in _LOOSENED:
        loose = seen.loosened(factor)
        agree = _distances(fit, loose, cameras) < _AGREES_D2
        if agree.sum() < MIN_STOPS:
            return _Fit(fit.T_building_map, fit.T_robot_tag, agree, math.inf)
        for _ in range(_STEPS):
            H, g, _ = _normal(fit, loose[agree], cameras, robust=factor > 1.0)
            change = np.asarray(np.linalg.solve(H + 1e-9 * np.diag(np.diag(H)) + 1e-12 * np.eye(_N), g), np.float64)
            fit = _moved(fit, change, seen)
            if np.abs(change).max() < 1e-7:
                break
    d2 = _distances(fit, seen, cameras)
    agree = d2 < _AGREES_D2
    return _Fit(fit.T_building_map, fit.T_robot_tag, agree, float(d2[agree].mean()) if agree.any() else math.inf)


def _distances(fit: _Fit, seen: Observations, cameras: _Array) -> _Array:
    """(n,) squared distances of the sightings, of 8 degrees of freedom."""
    state = fit.state(seen, cameras)
    return squared_distances(state, _in_building(seen, state))


def _in_building(seen: Observations, state: State) -> Observations:
    """The same with the stops in the building: as if the robot had said them there."""
    return replace(seen, stops=state.stops)


def _normal(fit: _Fit, seen: Observations, cameras: _Array, robust: bool = False) -> tuple[_Array, _Array, float]:
    """H (8, 8), gradient (8,) and the sum of squares of what is minimised, at a frame.

    The robot may stand beside where it says: that makes the corners of a sighting vary together, with the covariance
    I + J diag(sigma_stop^2) J^T in units of ``sigma_px``.
    """
    state = fit.state(seen, cameras)
    at = linearise(state, _in_building(seen, state))
    visible = at.visible
    by_stop = at.by_stop[visible]
    offset = state.stops[seen.stop[visible], :2] - (fit.T_building_map.x_m, fit.T_building_map.y_m)
    by_yaw = by_stop[..., 2] - by_stop[..., 0] * offset[:, 1:] + by_stop[..., 1] * offset[:, :1]
    J = np.concatenate([by_stop[..., :2], by_yaw[..., None], at.by_tag[visible]], axis=-1)
    S = np.eye(8) + np.einsum("nia,a,nja->nij", by_stop, np.square(seen.sigma_stop), by_stop)
    W = np.linalg.inv(S)
    r = at.residuals[visible]
    if robust:  # the weights of Geman and McClure
        W /= np.square(1.0 + np.einsum("ni,nij,nj->n", r, W, r) / _HALF_D2)[:, None, None]
    H = np.einsum("nia,nij,njb->ab", J, W, J)
    # the tag's place is known roughly, which matters only where the robot never turned
    H[3, 3] += _TAG_SIGMA_M**-2
    H[4, 4] += _TAG_SIGMA_M**-2
    g = np.einsum("nia,nij,nj->a", J, W, r)
    g[3:5] -= fit.T_robot_tag[:2, 3] / _TAG_SIGMA_M**2
    return H, g, float(np.einsum("ni,nij,nj->", r, W, r))


def _moved(fit: _Fit, change: _Array, seen: Observations) -> _Fit:
    T = fit.T_building_map
    frame = PlanarTransform(T.x_m + float(change[0]), T.y_m + float(change[1]), T.yaw_rad + float(change[2]))
    moved = State(np.empty((0, 4, 4)), fit.T_robot_tag, np.empty((0, 3))).moved(change[3:])
    return _Fit(frame, moved.T_robot_tag, fit.agree, fit.cost)


def _found(fit: _Fit, seen: Observations, cameras: _Array, names: list[str]) -> FoundFrame:
    state = fit.state(seen, cameras)
    here = _in_building(seen, state)
    used = here[fit.agree]
    off = stops_off(state, used)
    sigma_m, sigma_rad = _sigma(fit, seen[fit.agree], cameras)
    if not (sigma_m < _MAX_SIGMA_M and sigma_rad < _MAX_SIGMA_RAD):
        raise FrameError(
            "undetermined",
            f"by these stops, the map lies where it does within ± {sigma_m:.2f} m and ± {math.degrees(sigma_rad):.1f} degrees "
            "only: stop in several directions, and at places several metres apart, nearer to the cameras",
        )
    apart = stops_off(state, here[~fit.agree])
    left_out = [
        LeftOut(names[camera], int(stop) + 1, float(np.hypot(*moved[:2])), float(abs(moved[2])))
        for camera, stop, moved in zip(here.camera[~fit.agree], here.stop[~fit.agree], apart, strict=True)
    ]
    residual_m = float(np.sqrt(np.square(off[:, :2]).sum(axis=1).mean()))
    residual_rad = float(np.sqrt(np.square(off[:, 2]).mean()))
    T, stops = fit.T_building_map, sorted({int(stop) for stop in used.stop})
    text = (
        f"By the tag at {len(stops)} stops, seen by {_names(names, used.camera)}, {in_words(T)}, ± {100 * sigma_m:.0f} cm and "
        f"± {math.degrees(sigma_rad):.1f} degrees; the robot stood {100 * residual_m:.0f} cm from where it said on average"
    )
    text += _about_left_out(left_out, names, seen)
    numbers = tuple(sorted({entry.stop for entry in left_out} - {stop + 1 for stop in stops}))
    return FoundFrame(T, residual_m, residual_rad, "tag", len(used), text, numbers)


def _names(names: list[str], cameras: NDArray[np.intp]) -> str:
    used = [names[camera] for camera in np.unique(cameras)]
    return f"camera {used[0]}" if len(used) == 1 else f"cameras {', '.join(used[:-1])} and {used[-1]}"


def _about_left_out(left_out: list[LeftOut], names: list[str], seen: Observations) -> str:
    """Which sightings contradict the others; a camera of which most do."""
    if not left_out:
        return ""
    text = ""
    for camera, name in enumerate(names):
        n, n_left_out = int((seen.camera == camera).sum()), sum(entry.camera == name for entry in left_out)
        if n_left_out > 0.5 * n:
            text += f". {n_left_out} of {n} sightings by camera {name} contradict the others: its pose may be wrong"
    stops = sorted({entry.stop for entry in left_out})
    return f"{text}. Sightings at stop{'' if len(stops) == 1 else 's'} {listed(stops)} contradict the others and weren't all used"


def _sigma(fit: _Fit, seen: Observations, cameras: _Array) -> tuple[float, float]:
    """Standard deviations of where the frame puts the middle of the stops [m], and of its direction [rad]."""
    H, _, cost = _normal(fit, seen, cameras)
    covariance = np.linalg.inv(H) * max(1.0, cost / max(1, 8 * len(seen) - _N))
    used = fit.state(seen, cameras).stops[np.unique(seen.stop), :2]
    x, y = used.mean(axis=0) - (fit.T_building_map.x_m, fit.T_building_map.y_m)
    J = np.zeros((2, _N))
    J[:, :2], J[:, 2] = np.eye(2), (-y, x)
    return math.sqrt(max(0.0, float(np.trace(J @ covariance @ J.T)))), math.sqrt(max(0.0, float(covariance[2, 2])))
