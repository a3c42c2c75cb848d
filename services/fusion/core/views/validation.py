"""Validation of views: what can't be true is refused before it touches a map, and every fault has a name.

Faults of a view by itself (``check_view``):
    bad_pose            not finite, not a rigid transform, or a mounting offset that isn't finite
    wrong_size          pictures of another size than the intrinsics say
    bad_intrinsics      a focal length or principal point that no camera has
    bad_depth           negative or infinite depth
    bad_detection       a score or box that isn't finite, or a score outside 0-1
    bad_mask            a mask of another size than its box
    bad_embedding       an embedding that isn't finite, or of another length than the view's others

Faults of a view beside the earlier ones of its source (``ViewValidator``):
    no_depth            not one pixel has a depth, although the source says that it has one
    pose_jump           farther from the previous view than the source can have moved
    time_backwards      taken before the previous view
    intrinsics_changed  other intrinsics than in the previous view

The maps themselves add ``geometry_disagrees`` (a mistake in a camera's description, see ``plausibility``), ``quarantined``,
``frame_disagrees`` (a robot isn't where it says, see ``robot_frames``), ``out_of_map`` (farther away than a map may grow) and
``too_many_floors``.

A pixel without depth (NaN or 0) isn't a fault; it is left out.
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
from surveilnav.services.fusion.core.config import ValidationConfig

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
    "geometry_disagrees",
    "quarantined",
    "frame_disagrees",
    "out_of_map",
    "too_many_floors",
]
_MAX_MISSED = 2**53  # the largest number that every reader of a snapshot can represent
_MAX_ROTATION_ERROR = 1e-3  # largest element of |R^T R - 1|; quaternions on the wire are normalised


class ViewError(ValueError):
    """A view that the maps refuse; ``name`` says why (see the module's list). The maps are as they were."""

    def __init__(self, name: ViewFault, message: str) -> None:
        super().__init__(f"{name}: {message}")
        self.name: ViewFault = name


def check_view(view: PosedView, perception: ViewPerception | None) -> None:
    """Checks a view by itself, whatever came before it. Raises ViewError, which names the fault."""
    camera = view.camera
    size = camera.height_px, camera.width_px
    if view.depth_m.shape != size or view.rgb.shape != (*size, 3) or view.rgb.dtype != np.uint8:
        got = f"depth {view.depth_m.shape} and colour {view.rgb.shape} {view.rgb.dtype}"
        raise ViewError("wrong_size", f"its intrinsics are of {size} pixels, it came with {got}")
    _check_pose(view)
    _check_intrinsics(camera)
    if _find_invalid_depth(view.depth_m):
        raise ViewError("bad_depth", "depth is in metres from 0 up (0 or NaN: none), got negative or infinite ones")
    if perception is not None:
        _check_perception(perception, camera)


def _check_pose(view: PosedView) -> None:
    T = view.T_world_camera
    if T.shape != (4, 4) or not np.isfinite(T).all() or not math.isfinite(view.mounting_offset_m):
        raise ViewError("bad_pose", "a pose (4, 4) and a mounting offset must be finite numbers")
    R = T[:3, :3]
    if np.abs(R.T @ R - np.eye(3)).max() > _MAX_ROTATION_ERROR or np.linalg.det(R) < 0 or (T[3] != (0, 0, 0, 1)).any():
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
    """What the validator remembers of a view, to compare it with the next one of the same source and view index."""

    seq: int
    stamp_ns: int
    pose: tuple[float, ...]  # the first three rows of T_world_camera
    floor: str
    floor_z_m: float
    intrinsics: tuple[float, ...]
    words: tuple[str, ...] = ()  # the words that perception looked for in it

    @classmethod
    def from_view(cls, view: PosedView, perception: ViewPerception | None = None) -> LastView:
        """The view's pose must be finite."""
        c, pose = view.camera, tuple(view.T_world_camera[:3].ravel().tolist())
        intrinsics = float(c.width_px), float(c.height_px), c.fx_px, c.fy_px, c.cx_px, c.cy_px
        words: tuple[str, ...] = ()
        if perception is not None and not view.is_robot:  # only cameras' pictures are perceived again for new words
            words = _interned(tuple(sorted(perception.words)))
        return cls(view.seq, view.stamp_ns, pose, view.floor, view.floor_z_m, intrinsics, words)


@dataclass(frozen=True, slots=True)
class ValidationResult:
    """The answer of ``ViewValidator.validate``.

    Attributes:
        is_new: False if the maps hold exactly this picture already.
        fault: why the view is refused; None if it isn't.
        n_missed: number of observations of this robot that are missing between its previous one and this one.
        is_doubted: whether the view may be right all the same, so that a next view which agrees with it is accepted.
    """

    is_new: bool
    fault: ViewError | None = None
    n_missed: int = 0
    is_doubted: bool = False


class ViewValidator:
    """Compares each view with the previous one of its source.

    A view that can't follow the previous one is refused, but a next view that agrees with the refused one is accepted. So a robot
    that was relocalised, or whose clock was set, isn't refused for ever.

    Attributes:
        missed: number of observations that never arrived, by robot source.
    """

    def __init__(self, config: ValidationConfig) -> None:
        self._config = config
        self._last: dict[tuple[str, int], LastView] = {}
        self._doubted: dict[tuple[str, int], LastView] = {}
        self._last_seq: dict[str, int] = {}  # robot source -> the newest sequence number that arrived
        self.missed: dict[str, int] = {}

    def validate(self, view: PosedView) -> ValidationResult:
        """Compares a view that passed ``check_view`` with the previous one of its source.

        It changes nothing; ``record_arrival`` and ``record_integrated`` do.
        """
        key, current = (view.source, view.view), LastView.from_view(view)
        last, doubted = self._last.get(key), self._doubted.get(key)
        if last is not None and _is_repeat(last, current, view.is_robot):
            return ValidationResult(is_new=False)
        n_missed = self._count_missed(view)
        fault = self._fault(last, current, view.is_robot)
        agrees_with_doubted = (
            doubted is not None
            and not _is_repeat(doubted, current, view.is_robot)
            and not self._fault(doubted, current, view.is_robot)
        )
        if fault is not None and not agrees_with_doubted:
            return ValidationResult(True, fault, n_missed, is_doubted=True)
        if view.depth_source != "none" and not _has_depth(view.depth_m):
            return ValidationResult(True, ViewError("no_depth", "not one pixel has a depth"), n_missed)
        return ValidationResult(True, None, n_missed)

    def record_arrival(self, view: PosedView, result: ValidationResult) -> None:
        """Updates the counts by a view that has arrived, and remembers it if it was doubted."""
        if not result.is_new:
            return
        if view.is_robot:
            if result.n_missed:
                self.missed[view.source] = min(self.missed.get(view.source, 0) + result.n_missed, _MAX_MISSED)
            if view.source in self._last_seq or len(self._last_seq) < self._config.max_sources:
                self._last_seq[view.source] = view.seq
        key = (view.source, view.view)
        if result.is_doubted and (key in self._doubted or len(self._doubted) < self._config.max_sources):
            self._doubted[key] = LastView.from_view(view)

    def record_integrated(self, view: PosedView, perception: ViewPerception | None) -> None:
        """Remembers a view that the maps now hold, and the words that were looked for in it."""
        key, current = (view.source, view.view), LastView.from_view(view, perception)
        last = self._last.pop(key, None)
        if last is not None and _is_repeat(last, current, view.is_robot):  # the same picture, perceived for more words
            current = replace(current, words=_interned(tuple(sorted({*last.words, *current.words}))))
        self._last[key] = current
        if len(self._last) > self._config.max_sources:
            del self._last[next(iter(self._last))]
        self._doubted.pop(key, None)

    def cameras_current_since_ns(self) -> dict[str, int]:
        """By camera, the oldest stamp [ns] among the newest pictures of its views."""
        since_ns: dict[str, int] = {}
        for (source, _), last in self._last.items():
            if source.startswith("camera/"):
                since_ns[source] = min(last.stamp_ns, since_ns.get(source, last.stamp_ns))
        return since_ns

    def sources(self) -> set[str]:
        """The sources of the views that the maps hold."""
        return {source for source, _ in self._last}

    def new_words(self, view: PosedView, perception: ViewPerception) -> frozenset[str]:
        """The words that perception looked for in a camera's picture now and not before.

        Empty for a robot's view, and where the maps hold another picture of the view.
        """
        last = self._last.get((view.source, view.view))
        if last is None or view.is_robot or not _is_repeat(last, LastView.from_view(view), False):
            return frozenset()
        return frozenset(perception.words) - set(last.words)

    def _count_missed(self, view: PosedView) -> int:
        """The number of a robot's observations missing before this one. That isn't a fault, since only the newest one is sent."""
        if not view.is_robot:
            return 0
        return max(0, view.seq - self._last_seq.get(view.source, view.seq) - 1)

    def _fault(self, last: LastView | None, current: LastView, is_robot: bool) -> ViewError | None:
        """Why ``current`` can't follow ``last``; None if it can."""
        if last is None:
            return None
        if current.stamp_ns < last.stamp_ns:
            back_s = (last.stamp_ns - current.stamp_ns) / 1e9
            return ViewError("time_backwards", f"it was taken {back_s:.3f} s before the last one (view {last.seq})")
        if current.intrinsics != last.intrinsics:
            return ViewError("intrinsics_changed", f"the last one had {last.intrinsics}, this has {current.intrinsics}")
        # a source that counts from the start again may stand anywhere (a camera's first picture is often its only one)
        restarted = current.seq < last.seq or (current.seq == last.seq and not is_robot)
        climbed = (
            abs(current.floor_z_m - last.floor_z_m) > self._config.climb_m
        )  # another floor name alone doesn't count
        limit_m = self._config.max_step_m * max(1, current.seq - last.seq)
        moved_m = math.dist((current.pose[3], current.pose[7]), (last.pose[3], last.pose[7]))
        if moved_m > limit_m and not restarted and not climbed:
            return ViewError(
                "pose_jump", f"it moved {moved_m:.2f} m since view {last.seq}; at most {limit_m:g} m can be"
            )
        return None

    def state(self) -> dict[str, Any]:
        """Everything as plain values, for ``from_state``."""
        rows: dict[tuple[str, ...], int] = {}  # many views share one list of words: each list is stored once
        views = {
            name: [
                [*key, asdict(view) | {"words": rows.setdefault(view.words, len(rows))}] for key, view in views.items()
            ]
            for name, views in (("last", self._last), ("doubted", self._doubted))
        }
        return {**views, "words": list(rows), "last_seq": dict(self._last_seq), "missed": dict(self.missed)}

    @classmethod
    def from_state(cls, state: dict[str, Any], config: ValidationConfig) -> ViewValidator:
        validator = cls(config)
        words = [tuple(row) for row in state["words"]]
        validator._last, validator._doubted = (
            {(source, view): _last_view(fields, words) for source, view, fields in state[name]}
            for name in ("last", "doubted")
        )
        validator._last_seq, validator.missed = dict(state["last_seq"]), dict(state["missed"])
        return validator


@lru_cache(maxsize=4096)
def _interned(words: tuple[str, ...]) -> tuple[str, ...]:
    """The same tuple for equal words, so that a thousand views share one."""
    return words


def _last_view(fields: dict[str, Any], words: list[tuple[str, ...]]) -> LastView:
    lists = {"pose": tuple(fields["pose"]), "intrinsics": tuple(fields["intrinsics"])}
    return LastView(**(fields | lists | {"words": words[fields["words"]]}))


def _is_repeat(last: LastView, current: LastView, is_robot: bool) -> bool:
    """Whether both are the same observation: a robot may send its own twice, maybe with a new stamp."""
    if current.seq != last.seq:
        return False
    if current.stamp_ns == last.stamp_ns:
        return True
    return is_robot and (current.pose, current.floor) == (last.pose, last.floor)


@njit(cache=True, nogil=True)
def _find_invalid_depth(depth_m):  # type: ignore[no-untyped-def]
    for v in range(depth_m.shape[0]):
        for u in range(depth_m.shape[1]):
            if depth_m[v, u] < 0 or depth_m[v, u] == np.inf:
                return 1
    return 0


def _has_depth(depth_m: NDArray[np.floating]) -> bool:
    with np.errstate(invalid="ignore"):
        return bool((depth_m > 0).any())
