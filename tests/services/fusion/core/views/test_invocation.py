"""Eq. 1, and the hysteresis around it."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole
from surveilnav.messages import CameraInfo
from surveilnav.services.fusion.core import active_cameras
from surveilnav.services.fusion.core.views.invocation import Invocation, invoke

height = st.integers(-60, 60).map(lambda n: n / 10)  # in decimetres, so that tau_z itself is hit


def info(name: str, z_m: float, offset_m: float) -> CameraInfo:
    return CameraInfo(
        stamp_ns=1,
        camera=name,
        floor="0",
        position_m=(0.0, 0.0, z_m),
        mounting_offset_m=offset_m,
        intrinsics=Pinhole.from_hfov(64, 64, 1.5),
        views=[],
    )


@given(st.lists(height, max_size=3), st.lists(st.tuples(height, height), max_size=6))
def test_equals_the_equation(robots, cameras):
    infos = [info(f"c{i}", z, offset) for i, (z, offset) in enumerate(cameras)]
    alpha = {f"c{i}": 0 for i in range(len(cameras))}
    for z_robot in robots:
        for j, (z, offset) in enumerate(cameras):
            if abs(z_robot - (z - offset)) <= 0.4:
                alpha[f"c{j}"] = 1
    assert active_cameras(robots, infos, TAU) == sorted(c for c, a in alpha.items() if a)


def test_the_camera_upstairs_stays_asleep():
    infos = [info("here", 1.8, 1.8), info("split_level", 2.15, 1.8), info("upstairs", 4.6, 1.8)]
    assert active_cameras([0.0], infos, TAU) == ["here", "split_level"]
    assert active_cameras([0.0], infos, tau_z_m=0.1) == ["here"]
    assert active_cameras([], infos, TAU) == []
    assert active_cameras([0.0], [info("just", 0.4, 0.0)], TAU) == ["just"]  # tau_z itself is near enough


TAU, RELEASE = 0.4, 0.6
step = st.tuples(
    st.lists(height, max_size=3), st.integers(0, 30)
)  # where robots are, and deciseconds since the last look


def alpha(z_robots, z_camera, limit) -> bool:
    """Eq. 1, to the letter: 1 where |z_hat_robot - z_hat_camera| <= limit for some robot."""
    return any(abs(z - z_camera) <= limit for z in z_robots)


@given(st.lists(step, max_size=12), st.lists(st.tuples(height, height), max_size=6), st.integers(0, 20))
def test_hysteresis_equals_its_definition(looks, cameras, linger_ds):
    """Active from the first alpha = 1; until no robot was within the release band for longer than linger."""
    infos = [info(f"c{i}", z, offset) for i, (z, offset) in enumerate(cameras)]
    state, now_ds = Invocation(), 0
    active, last_near = [False] * len(cameras), [0] * len(cameras)
    for robots, wait_ds in looks:
        now_ds += wait_ds
        state = invoke(state, robots, infos, now_ds, tau_z_m=TAU, release_z_m=RELEASE, linger_s=linger_ds)
        for j, (z, offset) in enumerate(cameras):
            if alpha(robots, z - offset, TAU) or (active[j] and alpha(robots, z - offset, RELEASE)):
                active[j], last_near[j] = True, now_ds
            elif active[j] and now_ds - last_near[j] > linger_ds:
                active[j] = False
        assert state.active == sorted(f"c{j}" for j, a in enumerate(active) if a)


@given(st.lists(height, max_size=4), st.lists(st.tuples(height, height), max_size=6))
def test_without_bands_it_is_the_equation(robots, cameras):
    infos = [info(f"c{i}", z, offset) for i, (z, offset) in enumerate(cameras)]
    state = invoke(Invocation(), [0.0], infos, 0.0, tau_z_m=TAU, release_z_m=0.0, linger_s=0.0)
    state = invoke(state, robots, infos, 1.0, tau_z_m=TAU, release_z_m=0.0, linger_s=0.0)
    assert state.active == active_cameras(robots, infos, TAU)


def changes(z_of_robot, *, release_z_m, linger_s=0.0) -> dict[str, int]:
    """How often each of the cameras on three floors is invoked while a robot's altitude goes as told, 10 looks a second."""
    infos = [info(f"floor{k}", 2.8 * k + 1.8, 1.8) for k in range(3)]
    state, invoked = Invocation(), {i.camera: 0 for i in infos}
    for i, z in enumerate(z_of_robot):
        before = set(state.active)
        state = invoke(state, [z], infos, 0.1 * i, tau_z_m=TAU, release_z_m=release_z_m, linger_s=linger_s)
        for name in set(state.active) - before:
            invoked[name] += 1
    return invoked


def test_a_robot_on_a_stair_does_not_flap():
    rng = np.random.default_rng(4)
    wobble = 0.08 * rng.standard_normal(400)
    standing = TAU + wobble  # on the second step, where tau_z ends
    assert changes(standing, release_z_m=TAU)["floor0"] > 50  # without hysteresis each would cost 13 views
    assert changes(standing, release_z_m=RELEASE + 0.1)["floor0"] == 1
    assert changes(standing, release_z_m=RELEASE, linger_s=1.0)["floor0"] == 1
    up = np.concatenate([np.zeros(20), np.linspace(0, 2.8, 200), np.full(20, 2.8), np.linspace(2.8, 5.6, 200)])
    climb = up + np.resize(0.05 * rng.standard_normal(400), len(up))
    assert changes(climb, release_z_m=RELEASE + 0.1) == {"floor0": 1, "floor1": 1, "floor2": 1}
    assert max(changes(climb, release_z_m=TAU).values()) > 1


def test_activation_follows_the_robot_and_lets_go():
    infos = [info("below", 1.8, 1.8), info("above", 4.6, 1.8)]
    state, seen = Invocation(), []
    for i, z in enumerate((0.0, 0.5, 0.61, 1.4, 2.3, 2.4, 2.8, 2.8)):
        state = invoke(state, [z], infos, float(i), tau_z_m=TAU, release_z_m=RELEASE, linger_s=1.5)
        seen.append(state.active)
    both = ["above", "below"]
    assert seen == [["below"], ["below"], ["below"], [], [], ["above"], ["above"], ["above"]]
    two = invoke(state, [2.8, 0.0], infos, 9.0, tau_z_m=TAU, release_z_m=RELEASE, linger_s=1.5)
    assert two.active == both
