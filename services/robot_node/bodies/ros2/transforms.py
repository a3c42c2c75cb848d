"""The robot's tree of frames (tf2): transforms by the time at which they held, and where one frame was in another."""

from __future__ import annotations

import bisect
import math
import threading
from collections import deque

import numpy as np

from surveilnav.errors import SurveilNavError
from surveilnav.geometry import Matrix4, Pose
from surveilnav.geometry.se3 import inverse

_KEPT_NS = 20 * 10**9  # tf2 keeps ten seconds; a picture may come later over a slow link
_MAX_FRAMES = 500
_MAX_DEPTH = 50


class TransformError(SurveilNavError):
    """It can't be told where a frame was. The message says which transform is missing, for people."""


class TransformPendingError(TransformError):
    """It can't be told yet: the newest transform is older than the moment asked for."""


class TransformBuffer:
    """The transforms that the robot has told. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._static: dict[str, tuple[str, Matrix4]] = {}
        self._moving: dict[str, tuple[str, deque[tuple[int, Pose]]]] = {}

    def add(self, parent: str, child: str, stamp_ns: int, T_parent_child: Pose, *, static: bool = False) -> None:
        """Records where ``child`` was in ``parent`` at a moment; ``static``: and always is."""
        parent, child = parent.lstrip("/"), child.lstrip("/")
        with self._lock:
            if child not in self._static and child not in self._moving and self._n_frames() >= _MAX_FRAMES:
                return
            if static:
                self._static[child] = parent, T_parent_child.matrix()
                return
            known = self._moving.get(child)
            if known is None or known[0] != parent or (known[1] and stamp_ns < known[1][-1][0] - _KEPT_NS):
                known = self._moving[child] = parent, deque()  # a new tree, or a clock that was set back
            history = known[1]
            if history and stamp_ns <= history[-1][0]:
                return  # came twice, or late
            history.append((stamp_ns, T_parent_child))
            while stamp_ns - history[0][0] > _KEPT_NS:
                history.popleft()

    def newest_ns(self, child: str) -> int | None:
        """The time of the newest transform of a moving frame; None: there is none."""
        with self._lock:
            known = self._moving.get(child.lstrip("/"))
            return known[1][-1][0] if known else None

    def lookup(self, target: str, source: str, stamp_ns: int | None = None, hold_ns: int = 0) -> Matrix4:
        """``T_target_source`` (4, 4) at a moment; None: the newest that is known.

        Between two transforms it is interpolated. ``hold_ns``: how long the newest transform is taken to hold.

        Raises:
            TransformPendingError: the moment lies after the newest transform.
            TransformError: no chain of transforms joins the frames, or all that are kept are newer than the moment.
        """
        with self._lock:
            to_root = self._chain(source.lstrip("/"), stamp_ns, hold_ns, stop=target.lstrip("/"))
            if target.lstrip("/") in to_root:
                return to_root[target.lstrip("/")]
            of_target = self._chain(target.lstrip("/"), stamp_ns, hold_ns, stop="")
        common = next((frame for frame in of_target if frame in to_root), None)
        if common is None:
            known = ", ".join(sorted({*self._static, *self._moving})[:12]) or "none"
            raise TransformError(
                f"no transform leads from {source!r} to {target!r}; frames that have one: {known}. Is tf published?"
            )
        T: Matrix4 = inverse(of_target[common]) @ to_root[common]
        return T

    def _chain(self, frame: str, stamp_ns: int | None, hold_ns: int, stop: str) -> dict[str, Matrix4]:
        """``T_ancestor_frame`` for the frame and its ancestors, as far as ``stop``."""
        T, chain = np.eye(4), {frame: np.eye(4)}
        while frame != stop and len(chain) <= _MAX_DEPTH:
            step = self._step(frame, stamp_ns, hold_ns)
            if step is None or step[0] in chain:
                break
            frame, T = step[0], step[1] @ T
            chain[frame] = T
        return chain

    def _step(self, frame: str, stamp_ns: int | None, hold_ns: int) -> tuple[str, Matrix4] | None:
        if frame in self._moving:
            parent, history = self._moving[frame]
            return parent, _at(history, stamp_ns, hold_ns, f"{parent} -> {frame}")
        return self._static.get(frame)

    def _n_frames(self) -> int:
        return len(self._static) + len(self._moving)


def _at(history: deque[tuple[int, Pose]], stamp_ns: int | None, hold_ns: int, name: str) -> Matrix4:
    """The transform at a moment, from those before and after it."""
    newest_ns, newest = history[-1]
    if stamp_ns is None or newest_ns <= stamp_ns <= newest_ns + hold_ns:
        return newest.matrix()
    if stamp_ns > newest_ns:
        raise TransformPendingError(f"transform {name} is {(stamp_ns - newest_ns) / 1e9:.2f} s older than the picture")
    times = [t for t, _ in history]
    after = bisect.bisect_left(times, stamp_ns)
    if after == 0 and times[0] != stamp_ns:
        raise TransformError(f"transform {name} isn't known so far back: {(times[0] - stamp_ns) / 1e9:.2f} s too late")
    if times[after] == stamp_ns:
        return history[after][1].matrix()
    (t0, before), (t1, later) = history[after - 1], history[after]
    return _between(before, later, (stamp_ns - t0) / (t1 - t0))


def _between(a: Pose, b: Pose, share: float) -> Matrix4:
    """The pose at a share of the way from a to b: straight, and turning evenly (slerp, Shoemake 1985)."""
    p = np.asarray(a.translation_m) * (1 - share) + np.asarray(b.translation_m) * share
    qa, qb = np.asarray(a.quaternion_xyzw), np.asarray(b.quaternion_xyzw)
    cosine = float(qa @ qb)
    if cosine < 0:
        qb, cosine = -qb, -cosine
    angle = math.acos(min(1.0, cosine))
    if angle < 1e-6:
        q = qa * (1 - share) + qb * share
    else:
        q = (math.sin((1 - share) * angle) * qa + math.sin(share * angle) * qb) / math.sin(angle)
    q = q / np.linalg.norm(q)
    return Pose((float(p[0]), float(p[1]), float(p[2])), (float(q[0]), float(q[1]), float(q[2]), float(q[3]))).matrix()
