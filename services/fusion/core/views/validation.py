"""What is wrong with a view, by name: bad input is refused before it touches a map.

A view alone (``check``):
    bad_pose            not finite, not a rigid transform, or a mounting offset that isn't finite
    wrong_size          pictures of another size than the intrinsics say
    bad_intrinsics      a focal length or principal point that no camera has
    bad_depth           negative or infinite depth
    bad_detection       a score or box that isn't finite, or a score outside 0-1
    bad_mask            a mask of another size than its box
    bad_embedding       an embedding that isn't finite, or of another length than the view's others

A view among the others of its source (``Guard``):
    no_depth            not one pixel with a depth
    pose_jump           farther from the last view than it can have moved
    time_backwards      taken before the last view
    intrinsics_changed  another camera than in the last view

and from the maps themselves ``out_of_map`` (farther off than a map may grow) and ``too_many_floors``.

A pixel without depth (NaN or 0) is no fault: it is left out.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from surveilnav.geometry import Pinhole
from surveilnav.sensing.views import PosedView, ViewPerception, box_cells
from surveilnav.services.fusion.core.config import GuardConfig

ViewFault = Literal[
    "bad_pose",
    "wrong_size",
    "bad_intrinsics",
    "bad_depth",
    "bad_detection",
    "bad_mask",
    "bad_embedding",
    "no_depth",
    "pose_jump",
    "time_backwards",
    "intrinsics_changed",
    "out_of_map",
    "too_many_floors",
]
_MOST_MISSED = 2**53  # what every reader of a snapshot can hold
_RIGID = 1e-3  # of a rotation's R^T R - 1 and determinant; quaternions on the wire are normalised


class ViewError(ValueError):
    """A view that the maps refuse; ``name`` says why (see the module's list). The maps are as they were."""

    def __init__(self, name: ViewFault, message: str) -> None:
        super().__init__(f"{name}: {message}")
        self.name: ViewFault = name


def check(view: PosedView, perception: ViewPerception | None) -> None:
    """Everything that is wrong with a view whatever came before it. ViewError: by name."""
    camera = view.camera
    size = camera.height_px, camera.width_px
    if view.depth_m.shape != size or view.rgb.shape != (*size, 3) or view.rgb.dtype != np.uint8:
        got = f"depth {view.depth_m.shape} and colour {view.rgb.shape} {view.rgb.dtype}"
        raise ViewError("wrong_size", f"its intrinsics are of {size} pixels, it came with {got}")
    _check_pose(view)
    _check_intrinsics(camera)
    if _worst_depth(view.depth_m) != 0:
        raise ViewError("bad_depth", "depth is in metres from 0 up (0 or NaN: none), got negative or infinite ones")
    if perception is not None:
        _check_perception(perception, camera)


def _check_pose(view: PosedView) -> None:
    T = view.T_world_camera
    if T.shape != (4, 4) or not np.isfinite(T).all() or not math.isfinite(view.mounting_offset_m):
        raise ViewError("bad_pose", "a pose (4, 4) and a mounting offset must be finite numbers")
    R = T[:3, :3]
    if np.abs(R.T @ R - np.eye(3)).max() > _RIGID or np.linalg.det(R) < 0 or (T[3] != (0, 0, 0, 1)).any():
        raise ViewError("bad_pose", "a pose must be a rotation and a translation: no scale, no mirror")


def _check_intrinsics(camera: Pinhole) -> None:
    fovs = [2 * math.atan(n / (2 * f)) for n, f in ((camera.width_px, camera.fx_px), (camera.height_px, camera.fy_px))]
    if not all(math.radians(1) <= fov <= math.radians(175) for fov in fovs):
        angles = " x ".join(f"{math.degrees(fov):.1f}" for fov in fovs)
        raise ViewError("bad_intrinsics", f"a camera sees 1 to 175 degrees; focal lengths of {angles} degrees came")
    if not (0 <= camera.cx_px < camera.width_px and 0 <= camera.cy_px < camera.height_px):
        at = f"({camera.cx_px:.0f}, {camera.cy_px:.0f}) of {camera.width_px} x {camera.height_px}"
        raise ViewError("bad_intrinsics", f"the principal point lies in the picture, got {at}")


def _check_perception(perception: ViewPerception, camera: Pinhole) -> None:
    for d in perception.detections:
        if not np.isfinite([d.score, *d.box_px]).all() or not 0 <= d.score <= 1:
            raise ViewError("bad_detection", f"a detection of {d.label!r} needs a score from 0 to 1 and a finite box")
        if not np.isfinite(d.embedding).all():
            raise ViewError("bad_embedding", f"the embedding of a detection of {d.label!r} isn't finite")
        x0, y0, x1, y1 = box_cells(d.box_px, camera.width_px, camera.height_px)
        if d.mask is not None and d.mask.shape != (y1 - y0, x1 - x0):
            raise ViewError("bad_mask", f"a mask of {d.mask.shape} came with a box of {(y1 - y0, x1 - x0)} pixels")
    sizes = {perception.image_embedding.size, *(d.embedding.size for d in perception.detections)} - {0}
    if len(sizes) > 1:
        raise ViewError("bad_embedding", f"one model's embeddings have one length, got {sorted(sizes)}")
    if not np.isfinite(perception.image_embedding).all():
        raise ViewError("bad_embedding", "the embedding of the picture isn't finite")


@dataclass(frozen=True, slots=True)
class LastView:
    """What is remembered of a view, to check the next of the same source and view by."""

    seq: int
    stamp_ns: int
    pose: tuple[float, ...]  # T_world_camera, its first three rows
    floor: str
    floor_z_m: float
    intrinsics: tuple[float, ...]
    words: tuple[str, ...] = ()  # that it was looked at for

    @classmethod
    def of(cls, view: PosedView, perception: ViewPerception | None = None) -> LastView:
        """Of a view whose pose is finite."""
        c, pose = view.camera, tuple(view.T_world_camera[:3].ravel().tolist())
        intrinsics = float(c.width_px), float(c.height_px), c.fx_px, c.fy_px, c.cx_px, c.cy_px
        words: tuple[str, ...] = ()
        if perception is not None and not view.is_robot:  # a robot's view isn't looked at again
            words = _shared(tuple(sorted(perception.words)))
        return cls(view.seq, view.stamp_ns, pose, view.floor, view.floor_z_m, intrinsics, words)


class Guard:
    """Knows the last view of every source, and so what the next can't be.

    A view that doesn't fit the last one is refused, but the next that fits the refused one is believed: a robot that
    was relocalised, or whose clock was set, isn't refused for ever.
    """

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._last: dict[tuple[str, int], LastView] = {}
        self._doubted: dict[tuple[str, int], LastView] = {}
        self._heard: dict[str, int] = {}  # robot -> the newest sequence number that is processed
        self.missed: dict[str, int] = {}  # robot -> observations that never came

    def admit(self, view: PosedView, perception: ViewPerception | None) -> bool:
        """Whether a view that passed ``check`` is new: False for one that came before. Changes nothing in the maps.

        Raises:
            ViewError: by name.
        """
        key, now = (view.source, view.view), LastView.of(view)
        last, doubted = self._last.get(key), self._doubted.get(key)
        if last is not None and _repeats(last, now, view.is_robot):
            return False
        self._count_missed(view)
        fault = self._fault(last, now, view.is_robot)
        believed = (
            doubted is not None
            and not _repeats(doubted, now, view.is_robot)
            and not self._fault(doubted, now, view.is_robot)
        )
        if fault is not None and not believed:
            if key in self._doubted or len(self._doubted) < self._config.max_sources:
                self._doubted[key] = now
            raise fault
        if not _any_depth(view.depth_m):
            raise ViewError("no_depth", "not one pixel has a depth")
        return True

    def new_words(self, view: PosedView, perception: ViewPerception | None) -> frozenset[str]:
        """The words that a camera's view which the maps hold wasn't looked at for before; none if they hold another."""
        last = self._last.get((view.source, view.view))
        if perception is None or last is None or view.is_robot or not _repeats(last, LastView.of(view), False):
            return frozenset()
        return frozenset(perception.words) - set(last.words)

    def note(self, view: PosedView, perception: ViewPerception | None) -> None:
        """Remembers a view that the maps now hold."""
        key, now = (view.source, view.view), LastView.of(view, perception)
        last = self._last.pop(key, None)
        if last is not None and _repeats(last, now, view.is_robot):  # it was looked at again
            now = replace(now, words=_shared(tuple(sorted({*last.words, *now.words}))))
        self._last[key] = now
        if len(self._last) > self._config.max_sources:
            del self._last[next(iter(self._last))]
        self._doubted.pop(key, None)

    def _count_missed(self, view: PosedView) -> None:
        """Latest wins on the way here, so numbers may be missing: that is counted and no fault."""
        if not view.is_robot:
            return
        heard = self._heard.get(view.source, view.seq)
        if view.seq > heard + 1:
            self.missed[view.source] = min(self.missed.get(view.source, 0) + view.seq - heard - 1, _MOST_MISSED)
        if view.source in self._heard or len(self._heard) < self._config.max_sources:
            self._heard[view.source] = view.seq

    def _fault(self, last: LastView | None, now: LastView, is_robot: bool) -> ViewError | None:
        """Why ``now`` can't follow ``last``."""
        if last is None:
            return None
        if now.stamp_ns < last.stamp_ns:
            back_s = (last.stamp_ns - now.stamp_ns) / 1e9
            return ViewError("time_backwards", f"it was taken {back_s:.3f} s before the last one (view {last.seq})")
        if now.intrinsics != last.intrinsics:
            return ViewError("intrinsics_changed", f"the last one had {last.intrinsics}, this has {now.intrinsics}")
        # counting anew, and newer: it may stand anywhere (a camera's first picture is often its only one)
        restarted = now.seq < last.seq or (now.seq == last.seq and not is_robot)
        climbed = abs(now.floor_z_m - last.floor_z_m) > self._config.climb_m  # a new name alone is none
        limit_m = self._config.max_step_m * max(1, now.seq - last.seq)
        moved_m = math.dist((now.pose[3], now.pose[7]), (last.pose[3], last.pose[7]))
        if moved_m > limit_m and not restarted and not climbed:
            return ViewError(
                "pose_jump", f"it moved {moved_m:.2f} m since view {last.seq}; at most {limit_m:g} m can be"
            )
        return None

    def state(self) -> dict[str, Any]:
        """All of it, as plain values, for ``of_state``."""
        rows: dict[tuple[str, ...], int] = {}  # many views were looked at for the same words
        views = {
            name: [
                [*key, asdict(view) | {"words": rows.setdefault(view.words, len(rows))}] for key, view in kept.items()
            ]
            for name, kept in (("last", self._last), ("doubted", self._doubted))
        }
        return {**views, "words": list(rows), "heard": dict(self._heard), "missed": dict(self.missed)}

    @classmethod
    def of_state(cls, state: dict[str, Any], config: GuardConfig) -> Guard:
        """The guard that ``state`` was taken of."""
        guard = cls(config)
        words = [tuple(row) for row in state.get("words", [()])]  # version 2 knew of none
        guard._last, guard._doubted = (
            {(source, view): _last_view(fields, words) for source, view, fields in state[name]}
            for name in ("last", "doubted")
        )
        guard._heard, guard.missed = dict(state["heard"]), dict(state["missed"])
        return guard


@lru_cache(maxsize=4096)
def _shared(words: tuple[str, ...]) -> tuple[str, ...]:
    """The same words, once in memory however many views were looked at for them."""
    return words


def _last_view(fields: dict[str, Any], words: list[tuple[str, ...]]) -> LastView:
    lists = {"pose": tuple(fields["pose"]), "intrinsics": tuple(fields["intrinsics"])}
    return LastView(**(fields | lists | {"words": words[fields.get("words", 0)]}))


def _repeats(last: LastView, now: LastView, is_robot: bool) -> bool:
    """Whether it is the same observation: a robot says it again until somebody follows it up, maybe with a new stamp."""
    if now.seq != last.seq:
        return False
    return now.stamp_ns == last.stamp_ns or (is_robot and (now.pose, now.floor) == (last.pose, last.floor))


@njit(cache=True, nogil=True)
def _worst(depth_m):  # type: ignore[no-untyped-def]
    for v in range(depth_m.shape[0]):
        for u in range(depth_m.shape[1]):
            if depth_m[v, u] < 0 or depth_m[v, u] == np.inf:
                return 1
    return 0


def _worst_depth(depth_m: NDArray[np.floating]) -> int:
    return int(_worst(depth_m))


def _any_depth(depth_m: NDArray[np.floating]) -> bool:
    with np.errstate(invalid="ignore"):
        return bool((depth_m > 0).any())
