"""Eq. 1."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from services.fusion.core import active_cameras
from surveilnav.geometry import Pinhole
from surveilnav.messages import CameraInfo

height = st.integers(-60, 60).map(lambda n: n / 10)  # in decimetres, so that tau_z itself is hit


def info(name: str, z_m: float, offset_m: float) -> CameraInfo:
    return CameraInfo(
        stamp_ns=1, camera=name, floor="0", position_m=(0.0, 0.0, z_m), mounting_offset_m=offset_m,
        intrinsics=Pinhole.from_hfov(64, 64, 1.5), views=[],
    )  # fmt: skip


@given(st.lists(height, max_size=3), st.lists(st.tuples(height, height), max_size=6))
def test_equals_the_equation(robots, cameras):
    infos = [info(f"c{i}", z, offset) for i, (z, offset) in enumerate(cameras)]
    alpha = {f"c{i}": 0 for i in range(len(cameras))}
    for z_robot in robots:
        for j, (z, offset) in enumerate(cameras):
            if abs(z_robot - (z - offset)) <= 0.4:
                alpha[f"c{j}"] = 1
    assert active_cameras(robots, infos) == sorted(c for c, a in alpha.items() if a)


def test_the_camera_upstairs_stays_asleep():
    infos = [info("here", 1.8, 1.8), info("split_level", 2.15, 1.8), info("upstairs", 4.6, 1.8)]
    assert active_cameras([0.0], infos) == ["here", "split_level"]
    assert active_cameras([0.0], infos, tau_z_m=0.1) == ["here"]
    assert active_cameras([], infos) == []
    assert active_cameras([0.0], [info("just", 0.4, 0.0)]) == ["just"]  # tau_z itself is near enough
