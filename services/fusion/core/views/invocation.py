"""Active camera invocation (the paper's section IV-B): which cameras matter now (eq. 1), and until when."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from surveilnav.messages import CameraInfo


def same_floor(floor_z_m: float, other_floor_z_m: float, tau_z_m: float) -> bool:
    """The condition of eq. 1, ``|z_hat - z_hat'| <= tau_z``: whether two altitudes [m, world] are of one floor.

    z-hat is a sensor's altitude less its mounting offset: the altitude of the floor below it.
    """
    return abs(floor_z_m - other_floor_z_m) <= tau_z_m


def active_cameras(floors_z_m: Iterable[float], cameras: Iterable[CameraInfo], tau_z_m: float) -> list[str]:
    """Names of the cameras on a floor that some robot stands on, sorted (eq. 1).

    ``floors_z_m``: z-hat of each robot [m, world].
    """
    known_z_m = list(floors_z_m)
    return sorted(
        info.camera
        for info in cameras
        if any(same_floor(z_m, info.position_m[2] - info.mounting_offset_m, tau_z_m) for z_m in known_z_m)
    )


@dataclass(frozen=True, slots=True)
class Invocation:
    """The cameras that are active, each with when [s] a robot was last within the release band of its floor."""

    near_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def active(self) -> list[str]:
        """Names of the active cameras, sorted."""
        return sorted(self.near_s)


def invoke(
    state: Invocation,
    floors_z_m: Iterable[float],
    cameras: Iterable[CameraInfo],
    now_s: float,
    *,
    tau_z_m: float,
    release_z_m: float,
    linger_s: float,
) -> Invocation:
    """Eq. 1 with hysteresis: a camera becomes active within ``tau_z_m`` of a robot's floor, and stays so until every
    robot was farther than ``release_z_m`` for longer than ``linger_s``.

    The altitude under a robot on a stair wobbles around tau_z; every change of mind would cost all of a camera's views.
    An active camera that is no longer among ``cameras`` lingers, too. Neither band may lie inside the other:
    ``release_z_m`` less than ``tau_z_m`` counts as ``tau_z_m``.
    """
    known_z_m, known = list(floors_z_m), list(cameras)
    begins = active_cameras(known_z_m, known, tau_z_m)
    stays = set(active_cameras(known_z_m, known, max(tau_z_m, release_z_m))) & set(state.near_s)
    near_s = {**state.near_s, **dict.fromkeys([*begins, *stays], now_s)}
    return Invocation({name: at_s for name, at_s in near_s.items() if now_s - at_s <= linger_s})
