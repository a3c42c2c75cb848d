"""Active camera invocation (the paper's section IV-B): which cameras are active (eq. 1), and for how long they stay so."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from surveilnav.messages import CameraInfo


def same_floor(floor_z_m: float, other_floor_z_m: float, tau_z_m: float) -> bool:
    """The condition of eq. 1, ``|z_hat - z_hat'| <= tau_z``: whether two floor altitudes [m, world] are of the same floor.

    z_hat is a sensor's altitude minus its mounting offset, which is the altitude of the floor below it.
    """
    return abs(floor_z_m - other_floor_z_m) <= tau_z_m


def active_cameras(floors_z_m: Iterable[float], cameras: Iterable[CameraInfo], tau_z_m: float) -> list[str]:
    """Names of the cameras on a floor that some robot is on, sorted (eq. 1).

    Args:
        floors_z_m: z_hat of each robot [m, world].
    """
    robots_z_m = list(floors_z_m)
    return sorted(
        info.camera
        for info in cameras
        if any(same_floor(z_m, info.position_m[2] - info.mounting_offset_m, tau_z_m) for z_m in robots_z_m)
    )


@dataclass(frozen=True, slots=True)
class Invocation:
    """The active cameras, each with the time [s] at which a robot was last within the release band of its floor."""

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
    """Eq. 1 with hysteresis: the active cameras now, given those of the last call.

    A camera becomes active when a robot's floor is within ``tau_z_m`` of its own. It stays active until every robot has been
    farther away than ``release_z_m`` for longer than ``linger_s``. Without that, a camera would be switched on and off while the
    altitude of a robot on a stair varies around tau_z, and would send all its views anew each time. An active camera that
    is no longer among ``cameras`` lingers as well. A ``release_z_m`` smaller than ``tau_z_m`` counts as ``tau_z_m``.
    """
    robots_z_m, known = list(floors_z_m), list(cameras)
    entering = active_cameras(robots_z_m, known, tau_z_m)
    staying = set(active_cameras(robots_z_m, known, max(tau_z_m, release_z_m))) & set(state.near_s)
    near_s = {**state.near_s, **dict.fromkeys([*entering, *staying], now_s)}
    return Invocation({name: at_s for name, at_s in near_s.items() if now_s - at_s <= linger_s})
