from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from surveilnav.camera_pose import solve, solve_pose
from surveilnav.camera_pose.angles import angle_sigmas, yaw_pitch_roll
from surveilnav.errors import PoseError
from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.geometry.lens import BrownConrady, KannalaBrandt, Lens
from tests.clicked_points import LENS, T_WORLD_CAMERA, Scene, pose_error, scene

BARREL = BrownConrady(LENS.pinhole, (-0.25, 0.08, 0.001, -0.002))
FISHEYE = KannalaBrandt(Pinhole(1280, 960, 420.0, 420.0, 639.5, 479.5), (-0.02, 0.003, 0.0, 0.0))
DOWN = camera_pose((3.0, -2.0, 2.8), 0.7, -math.pi / 2)


@pytest.mark.parametrize("n", [4, 5, 8])
@pytest.mark.parametrize("door_tops", [False, True])
@pytest.mark.parametrize("lens", [LENS, BARREL, FISHEYE], ids=["pinhole", "barrel", "fisheye"])
@pytest.mark.parametrize("place", [(0.0, 0.0), (512_300.0, 5_400_100.0)], ids=["near", "map-grid"])
def test_exact_clicks_give_the_exact_pose(n: int, door_tops: bool, lens: Lens, place: tuple[float, float]) -> None:
    T = camera_pose((*place, 2.5), 0.4, math.radians(-25))
    seen = scene(np.random.default_rng(n), n, door_tops, lens, T, ahead_m=(1.5, 7.0))
    fit = solve_pose(lens, seen.pixels, seen.p_world, sigma_px=0.2, sigma_world_m=0.002)
    assert pose_error(fit.T_world_camera, T) == pytest.approx(np.zeros(6), abs=2e-5)
    assert fit.inliers.all()
    assert np.abs(fit.residuals_px).max() < 2e-3
    assert fit.residuals_m.max() < 2e-5
    assert (fit.hfov_rad, fit.hfov_sigma_rad) == (lens.hfov_rad, 0.0)


def test_a_pinhole_camera_is_a_lens_and_the_floor_may_be_anywhere() -> None:
    seen = scene(np.random.default_rng(1), 6, True)
    raised = seen.p_world + np.array([0.0, 0.0, -7.5])
    fit = solve_pose(LENS.pinhole, seen.pixels, raised, floor_z_m=-7.5)
    assert fit.T_world_camera[:3, 3] == pytest.approx([0, 0, -5.0], abs=1e-4)


# Medians of notes from an unweighted solver (SQPNP, then Levenberg-Marquardt) on the same scene, rounded up by a quarter.
@pytest.mark.parametrize(("n", "median_m", "median_deg"), [(5, 0.105, 0.85), (6, 0.085, 0.62), (10, 0.05, 0.44)])
def test_errors_of_clicks_and_the_uncertainty_that_is_stated(n: int, median_m: float, median_deg: float) -> None:
    errors, squares, stated_m = [], [], []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        clicked = scene(rng, n, seed % 2 == 0).with_errors(rng)
        fit = solve_pose(LENS, clicked.pixels, clicked.p_world)
        error = pose_error(fit.T_world_camera, T_WORLD_CAMERA)
        errors.append((np.linalg.norm(error[:3]), math.degrees(np.linalg.norm(error[3:]))))
        squares.append(error @ np.linalg.solve(fit.covariance, error) / 6)
        stated_m.append(fit.position_sigma_m)
    assert (np.median(errors, axis=0) < (median_m, median_deg)).all()
    assert 0.6 < np.mean(squares) < 1.3  # 1: errors are spread just as the covariance says
    rms_m = math.sqrt(np.mean(np.square([m for m, _ in errors])))
    assert 0.7 < rms_m / math.sqrt(np.mean(np.square(stated_m))) < 1.3


def test_twice_the_assumed_errors_are_stated_as_a_larger_uncertainty() -> None:
    seen = scene(np.random.default_rng(3), 30, True)
    assumed = solve_pose(LENS, *_both(seen.with_errors(np.random.default_rng(3))))
    twice = solve_pose(LENS, *_both(seen.with_errors(np.random.default_rng(3), 4.0, 0.04)))
    assert 1.5 < twice.position_sigma_m / assumed.position_sigma_m < 2.5


@pytest.mark.parametrize("seed", range(6))
def test_one_wrong_click_of_seven_is_named(seed: int) -> None:
    rng = np.random.default_rng(seed)
    clicked = scene(rng, 7, seed % 2 == 0, margin_px=130).with_errors(rng)
    clicked.pixels[seed] += 120 * np.array([math.cos(seed), math.sin(seed)])
    fit = solve_pose(LENS, clicked.pixels, clicked.p_world)
    assert np.flatnonzero(~fit.inliers).tolist() == [seed]
    assert np.linalg.norm(fit.residuals_px[seed]) > 60
    assert np.linalg.norm(pose_error(fit.T_world_camera, T_WORLD_CAMERA)[:3]) < 4 * fit.position_sigma_m


def test_the_same_clicks_give_the_same_pose() -> None:
    rng = np.random.default_rng(5)
    clicked = scene(rng, 12, True, margin_px=130).with_errors(rng)
    clicked.pixels[4] += 100
    a, b = (solve_pose(LENS, clicked.pixels, clicked.p_world) for _ in range(2))
    assert (a.T_world_camera == b.T_world_camera).all()


@pytest.mark.parametrize("lens", [LENS, FISHEYE], ids=["pinhole", "fisheye"])
@pytest.mark.parametrize("n", [4, 6])
def test_a_ceiling_camera_that_looks_straight_down(lens: Lens, n: int) -> None:
    rng = np.random.default_rng(n)
    seen = scene(rng, n, False, lens, DOWN, ahead_m=(-4.0, 4.0))
    fit = solve_pose(lens, seen.pixels, seen.p_world, sigma_px=0.2, sigma_world_m=0.002)
    assert pose_error(fit.T_world_camera, DOWN) == pytest.approx(np.zeros(6), abs=1e-4)
    clicked = seen.with_errors(rng, 0.2, 0.002)
    fit = solve_pose(lens, clicked.pixels, clicked.p_world, 0.2, 0.002)
    assert np.linalg.norm(pose_error(fit.T_world_camera, DOWN)[:3]) < 4 * fit.position_sigma_m


def test_an_upside_down_camera_is_found_if_the_clicks_say_so() -> None:
    T = T_WORLD_CAMERA @ np.diag([-1.0, -1.0, 1.0, 1.0])
    seen = scene(np.random.default_rng(2), 6, True, T_world_camera=T)
    fit = solve_pose(LENS, seen.pixels, seen.p_world)
    assert pose_error(fit.T_world_camera, T) == pytest.approx(np.zeros(6), abs=1e-4)
    assert abs(math.degrees(yaw_pitch_roll(fit.T_world_camera)[2])) == pytest.approx(180)


def _telephoto(seed: int) -> tuple[BrownConrady, Matrix4, Scene]:
    """A lens of 24 degrees that sees four points of a small part of the floor: hardly any perspective tells where it hangs."""
    lens, T = (
        BrownConrady(Pinhole(1280, 960, 3000.0, 3000.0, 639.5, 479.5)),
        camera_pose((0, 0, 2.5), 0, math.radians(-50)),
    )
    rng = np.random.default_rng(seed)
    p_world = np.array([[2.1 + x, y, 0.0] for x in (-0.12, 0.12) for y in (-0.12, 0.12)])
    p_world[:, :2] += rng.uniform(-0.03, 0.03, (4, 3))[:, :2]
    seen = Scene(lens.pixels((p_world - T[:3, 3]) @ T[:3, :3]), p_world)
    return lens, T, seen.with_errors(rng, 4.0, 0.001)


@pytest.mark.parametrize("seed", range(10))
def test_of_the_two_poses_that_points_of_a_plane_allow_it_is_the_upright_one(seed: int) -> None:
    lens, T, clicked = _telephoto(seed)
    fit = solve_pose(lens, clicked.pixels, clicked.p_world, 4.0, 0.001)
    assert np.linalg.norm(pose_error(fit.T_world_camera, T)[:3]) < 0.4


def test_two_poses_that_explain_the_points_equally_well_are_no_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solve, "_UPSIDE_DOWN_D2", 0.0)  # as if cameras hung either way
    lens, _, clicked = _telephoto(1)
    with pytest.raises(PoseError, match=r"two poses \d\.\d m apart.*top of a door"):
        solve_pose(lens, clicked.pixels, clicked.p_world, 4.0, 0.001)


@pytest.mark.parametrize("factor", [0.8, 1.25])
@pytest.mark.parametrize("lens", [LENS, FISHEYE], ids=["pinhole", "fisheye"])
def test_the_field_of_view_is_fitted(factor: float, lens: Lens) -> None:
    rng = np.random.default_rng(8)
    clicked = scene(rng, 14, True, lens, ahead_m=(1.0, 6.0)).with_errors(rng, 1.0, 0.01)
    pinhole = lens.pinhole
    given = Pinhole(1280, 960, pinhole.fx_px * factor, pinhole.fy_px * factor, pinhole.cx_px, pinhole.cy_px)
    fit = solve_pose(type(lens)(given, lens.distortion), clicked.pixels, clicked.p_world, 1.0, 0.01, fit_hfov=True)
    assert abs(fit.hfov_rad - lens.hfov_rad) < 4 * fit.hfov_sigma_rad < math.radians(12)
    assert np.linalg.norm(pose_error(fit.T_world_camera, T_WORLD_CAMERA)[:3]) < 4 * fit.position_sigma_m


def _both(seen: Scene) -> tuple[np.ndarray, np.ndarray]:
    return seen.pixels, seen.p_world


def _good(n: int = 8) -> tuple[np.ndarray, np.ndarray]:
    return _both(scene(np.random.default_rng(0), n, False, margin_px=100))


def _line() -> tuple[np.ndarray, np.ndarray]:
    p_world = np.array([[2.0 + k, 0.5 * k, 0.0] for k in range(6)])
    return LENS.pixels((p_world - T_WORLD_CAMERA[:3, 3]) @ T_WORLD_CAMERA[:3, :3]), p_world


def _small_part() -> tuple[np.ndarray, np.ndarray]:
    p_world = np.array([[8.0, 0.0, 0.0], [8.5, 0.0, 0.0], [8.0, 0.5, 0.0], [8.5, 0.5, 0.0], [8.2, 0.2, 0.0]])
    return LENS.pixels((p_world - T_WORLD_CAMERA[:3, 3]) @ T_WORLD_CAMERA[:3, :3]), p_world


def _mirrored() -> tuple[np.ndarray, np.ndarray]:
    pixels, p_world = _good()
    return pixels, p_world * (1, -1, 1)


def _contradicting() -> tuple[np.ndarray, np.ndarray]:
    pixels, p_world = _good(6)
    pixels[1] += (90, 0)
    pixels[4] -= (0, 90)
    return pixels, p_world


def _outside() -> tuple[np.ndarray, np.ndarray]:
    pixels, p_world = _good()
    pixels[2] = (1400, 20)
    return pixels, p_world


FAULTS: dict[str, tuple[Callable[[], tuple[np.ndarray, np.ndarray]], bool, str]] = {
    "three points": (lambda: _good(3), False, r"at least 4 points.*got 3"),
    "on a line": (_line, False, r"on one line.*both sides"),
    "a small part of the picture": (_small_part, False, r"uncertain by ±\d+\.\d m: they cover 0\.\d % of the picture"),
    "mirrored plan": (_mirrored, False, r"only a camera 2\.5 m below the floor.*y axis points down"),
    "contradicting": (_contradicting, False, r"contradict each other.*point \d is \d+ px \(\d+ cm\) off"),
    "outside the picture": (_outside, False, r"point 3 at \(1400, 20\) lies outside the picture of 1280 x 960"),
    "field of view from the floor alone": (_good, True, r"to fit the field of view.*tops of doors"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_says_what_to_do(fault: str) -> None:
    make, fit_hfov, message = FAULTS[fault]
    with pytest.raises(PoseError, match=message):
        solve_pose(LENS, *make(), fit_hfov=fit_hfov)


@pytest.mark.parametrize(
    ("fault", "numbers"), [("outside the picture", {3}), ("contradicting", {2, 5}), ("on a line", set())]
)
def test_a_fault_has_the_numbers_of_its_points(fault: str, numbers: set[int]) -> None:
    make, fit_hfov, _ = FAULTS[fault]
    with pytest.raises(PoseError) as raised:
        solve_pose(LENS, *make(), fit_hfov=fit_hfov)
    assert numbers <= set(raised.value.points)
    assert all(f"point {number} " in str(raised.value) for number in raised.value.points)


def test_where_the_lens_sees_nothing_no_point_can_be() -> None:
    pixels, p_world = _good()
    pixels[0] = (2, 2)
    narrow = KannalaBrandt(FISHEYE.pinhole, (), max_angle_rad=math.radians(70))
    with pytest.raises(PoseError, match="point 1 lies where the lens sees nothing"):
        solve_pose(narrow, pixels, p_world)


@pytest.mark.parametrize("roll_deg", [0.0, -30.0, 170.0])
@pytest.mark.parametrize("pitch_deg", [-89.0, -25.0, 40.0])
def test_angles_are_those_of_the_camera(pitch_deg: float, roll_deg: float) -> None:
    T, roll = camera_pose((1, 2, 3), 2.0, math.radians(pitch_deg)), math.radians(roll_deg)
    T[:3, :3] = T[:3, :3] @ [[math.cos(roll), -math.sin(roll), 0], [math.sin(roll), math.cos(roll), 0], [0, 0, 1]]
    assert np.degrees(yaw_pitch_roll(T)) == pytest.approx([math.degrees(2.0), pitch_deg, roll_deg])


def test_a_camera_that_looks_straight_down_has_the_yaw_of_its_top() -> None:
    assert np.degrees(yaw_pitch_roll(DOWN)) == pytest.approx([math.degrees(0.7), -90, 0])


def test_errors_of_the_angles_are_those_of_turned_cameras() -> None:
    T = camera_pose((1, 2, 3), math.pi, math.radians(-50))  # its yaw jumps from pi to -pi
    rng = np.random.default_rng(0)
    half = np.array([[0.006, 0.0, 0.0], [0.002, 0.004, 0.0], [0.0, -0.003, 0.005]])
    spread = []
    for rotation in rng.normal(size=(4000, 3)) @ half.T:
        turned = T.copy()
        turned[:3, :3] = cv2.Rodrigues(rotation)[0] @ T[:3, :3]
        spread.append(np.subtract(yaw_pitch_roll(turned), yaw_pitch_roll(T)))
    spread = (np.array(spread) + math.pi) % (2 * math.pi) - math.pi
    assert angle_sigmas(T, half @ half.T) == pytest.approx(np.std(spread, axis=0), rel=0.06)
