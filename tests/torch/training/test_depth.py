"""Training of the depth network: it learns, goes on where it was, and its ONNX file says what PyTorch says."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import msgspec
import numpy as np
import pytest
import torch

from surveilnav.perception.depth import DepthNetwork, reference_depth
from surveilnav.perception.depth.network import FORMAT_KEY
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.runtime import Runtime
from training.depth.data import Views, varied
from training.depth.export import export, fitted_factor
from training.depth.network import DepthNet, Shape
from training.depth.pack import SUFFIX, DepthView, Pack, ViewGeometry, read_packs, write_pack
from training.depth.train import Plan, Training, losses
from training.learning import n_parameters

SMALL = Shape(8, 4, (8, 12, 16, 16), (1, 1, 1, 1), (16, 12, 8), 4)
SIDE = 256


def view(seed: int) -> DepthView:
    """Looking down at a green floor with a red block on it, whose top is half a metre high."""
    rng = np.random.default_rng(seed)
    geometry = ViewGeometry(math.radians(90), rng.uniform(1.8, 2.6), math.radians(-70), 0.0, False)
    camera, pose = geometry.camera(SIDE), geometry.pose()
    depth_m = reference_depth(camera, pose, 0.0).depth_m.copy()
    rgb = np.full((SIDE, SIDE, 3), (40, 160, 60), np.uint8)
    x, y = rng.integers(20, 140, 2)
    block = np.s_[y : y + 90, x : x + 90]
    rgb[block] = (200, 40, 30)
    depth_m[block] = reference_depth(camera, pose, 0.5).depth_m[block]
    return DepthView(geometry, rgb, depth_m.astype(np.float16))


@pytest.fixture
def packs(tmp_path: Path) -> list[Pack]:
    for k in range(2):
        write_pack(tmp_path / "views" / f"{k}{SUFFIX}", str(k), SIDE, [view(10 * k + i) for i in range(4)])
    return read_packs(tmp_path / "views")


def test_the_network_keeps_to_its_budget() -> None:
    assert n_parameters(DepthNet()) < 1_000_000


def test_targets_are_exact_on_the_floor_and_true_elsewhere() -> None:
    one = view(3)
    for seed in range(12):
        example = varied(one, (192, 160), np.random.default_rng(seed))
        assert example.geometry.shape == (80, 96, 5)
        assert (example.log_ratio[example.floor] == 0.0).all()
        height_m = 2.0 + example.geometry[0, 0, 4]
        block = ~example.floor & example.known & (cv2.erode((~example.floor).astype(np.uint8), np.ones((5, 5))) > 0)
        expected = math.log(1.0 - 0.5 / height_m)
        if block.any():  # the building's size, the calibration and rounding shift it
            assert np.median(example.log_ratio[block]) == pytest.approx(expected, abs=0.12)


def test_it_learns_and_goes_on_where_it_was(packs: list[Pack], tmp_path: Path) -> None:
    plan = Plan(24, batch=4, warm_up=2, rate=1e-2)

    def training(folder: str, steps: int) -> Training:
        run = Training(plan, Views(packs, 0, 24), tmp_path / folder, SMALL)
        for step in range(run.step, steps):
            run.one_step(run.views.batch(step, 4))
        run.save()
        return run

    whole = training("whole", 24)
    training("parts", 10)
    parts = training("parts", 24)
    assert parts.step == 24
    for a, b in zip(whole.network.parameters(), parts.network.parameters(), strict=True):
        assert torch.allclose(a, b, atol=1e-4)
    batch = whole.views.batch(99, 4)
    pictures, untrained = batch.pictures.float() / 255.0, DepthNet(SMALL).train()
    before = losses(untrained(pictures, batch.geometry), batch)
    after = losses(whole.network(pictures, batch.geometry), batch)
    assert after["floor"] < 0.8 * before["floor"]


def test_its_file_says_what_pytorch_says(tmp_path: Path) -> None:
    torch.manual_seed(1)
    network, path = DepthNet(SMALL).eval(), tmp_path / "depth.onnx"
    export(network, path, factor=1.5)
    session = open_session(path, Runtime(device="cpu"))
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (1, 160, 96, 3), dtype=np.uint8)
    geometry = rng.normal(size=(1, 80, 48, 5)).astype(np.float32)
    log_ratio, sigma_log, floor = session.run(None, {"picture": picture, "geometry": geometry})
    with torch.no_grad():
        said = network(
            torch.from_numpy(picture).permute(0, 3, 1, 2).float() / 255, torch.from_numpy(geometry).permute(0, 3, 1, 2)
        )
    np.testing.assert_allclose(log_ratio, said.log_ratio[0], atol=1e-4)
    np.testing.assert_allclose(sigma_log, 1.5 * said.log_sigma[0].exp(), rtol=1e-3)
    np.testing.assert_allclose(floor, said.floor[0].sigmoid(), atol=1e-4)
    assert FORMAT_KEY in session.get_modelmeta().custom_metadata_map
    DepthNetwork(path)


def test_the_factor_covers_68_in_100_errors(packs: list[Pack], tmp_path: Path) -> None:
    network, path = DepthNet(SMALL).eval(), tmp_path / "depth.onnx"
    export(network, path)
    factor = fitted_factor(path, tmp_path / "views")
    export(network, path, factor)
    assert fitted_factor(path, tmp_path / "views") == pytest.approx(1.0, abs=0.02)


def test_a_mirrored_view_has_the_mirrored_geometry() -> None:
    rolled = msgspec.structs.replace(view(0).geometry, roll_rad=0.05)
    mirrored = msgspec.structs.replace(rolled, roll_rad=-0.05)
    camera = rolled.camera(64)
    a = reference_depth(camera, rolled.pose(), 0.0).depth_m
    b = reference_depth(camera, mirrored.pose(), 0.0).depth_m
    np.testing.assert_allclose(a[:, ::-1], b, rtol=1e-4)
