"""The depth network in the package: on rendered views of a flat that it wasn't trained on, and on inputs it should refuse."""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Matrix4, Pinhole, camera_pose
from surveilnav.perception.depth import DepthNetwork, reference_depth
from surveilnav.perception.depth.estimate import MAX_SIGMA_LOG
from surveilnav.perception.depth.network import BUILT_IN, input_size
from surveilnav.simulator.render.renderer import Renderer
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.scene import Scene
from tests.compact_file import write

DOWN_RAD = math.radians(-30)


@pytest.fixture(scope="module")
def network() -> DepthNetwork:
    return DepthNetwork()


@pytest.fixture(scope="module")
def flat() -> Scene:
    return open_building("parametric_flat")


def poses(scene: Scene) -> list[Matrix4]:
    """Two metres above the middle of each room's floor, looking at its farthest corner."""
    out = []
    for room in scene.rooms:
        corners = np.array(room.polygon_m)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        to = corners[np.argmax(np.hypot(*(corners - middle).T))] - middle
        out.append(camera_pose((*middle, scene.floors[0].z_m + 2.0), math.atan2(to[1], to[0]), DOWN_RAD))
    return out


def test_in_an_unknown_flat_depth_is_far_better_than_that_of_an_empty_room(network: DepthNetwork, flat: Scene) -> None:
    renderer, camera, floor_z_m = Renderer(flat, lighting="flat"), Pinhole.from_hfov(256, 256, 1.7), flat.floors[0].z_m
    errors, of_empty, floor_found, taken_wrongly = [], [], [], []
    for T in poses(flat):
        seen = renderer.render(T, camera)
        reference = reference_depth(camera, T, floor_z_m)
        estimate = network.estimate(seen.rgb, camera, T, floor_z_m)
        there = (seen.depth_m > 0.3) & (estimate.depth_m > 0)
        errors.append(np.abs(estimate.depth_m / np.maximum(seen.depth_m, 0.1) - 1)[there])
        of_empty.append(np.abs(reference.depth_m / np.maximum(seen.depth_m, 0.1) - 1)[there])
        is_floor = np.abs(seen.depth_m / reference.depth_m - 1) < 0.01
        floor_found.append((estimate.floor > 0.5)[is_floor & reference.floor])
        taken_wrongly.append((estimate.floor > 0.5)[(seen.depth_m < 0.9 * reference.depth_m) & there])
    not_floor = np.concatenate(of_empty) > 0.03
    median = np.median(np.concatenate(errors)[not_floor])
    assert median < 0.25
    assert median < 0.5 * np.median(np.concatenate(of_empty)[not_floor])
    assert np.concatenate(floor_found).mean() > 0.7
    assert np.concatenate(taken_wrongly).mean() < 0.1


@pytest.mark.parametrize(
    ("size", "inner"),
    [((640, 480), (256, 192)), ((1280, 720), (256, 160)), ((90, 160), (160, 256)), ((300, 20), (256, 32))],
)
def test_depth_has_the_size_of_the_picture(
    network: DepthNetwork, size: tuple[int, int], inner: tuple[int, int]
) -> None:
    assert input_size(*size) == inner
    camera = Pinhole.from_hfov(*size, 1.4)
    rgb = np.random.default_rng(1).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)
    estimate = network.estimate(rgb, camera, camera_pose((0, 0, 2.0), 0.3, DOWN_RAD), 0.0)
    for map_ in (estimate.depth_m, estimate.sigma_log, estimate.floor):
        assert map_.shape == (size[1], size[0])
        assert map_.dtype == np.float32


@pytest.mark.parametrize("grey", [0, 255])
@pytest.mark.parametrize("pitch", [DOWN_RAD, -math.pi / 2, 0.5])
def test_a_picture_of_nothing_gives_finite_values(network: DepthNetwork, grey: int, pitch: float) -> None:
    camera = Pinhole.from_hfov(128, 128, 1.7)
    picture = np.full((128, 128, 3), grey, np.uint8)
    estimate = network.estimate(picture, camera, camera_pose((0, 0, 2.0), 0, pitch), 0.0)
    assert ((estimate.depth_m >= 0.0) & (estimate.depth_m <= 10.0)).all()
    assert ((estimate.floor >= 0.0) & (estimate.floor <= 1.0)).all()
    assert (estimate.sigma_log > 0.0).all()
    assert np.isfinite(estimate.sigma_log).all()
    assert (estimate.depth_m[estimate.sigma_log > MAX_SIGMA_LOG] == 0.0).all()


def test_what_is_taken_for_floor_has_the_depth_of_the_floor(network: DepthNetwork, flat: Scene) -> None:
    camera, T = Pinhole.from_hfov(320, 240, 1.5), poses(flat)[0]
    rgb = Renderer(flat, lighting="flat").render(T, camera).rgb
    estimate = network.estimate(rgb, camera, T, flat.floors[0].z_m)
    taken = (estimate.floor > 0.5) & (estimate.depth_m > 0)
    assert taken.any()
    reference = reference_depth(camera, T, flat.floors[0].z_m)
    np.testing.assert_array_equal(estimate.depth_m[taken], reference.depth_m[taken])


def test_another_network_is_refused_with_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(PerceptionError, match=r"no depth network.*expected inputs picture, geometry.*it has.*scores"):
        DepthNetwork(write(tmp_path / "compact.onnx"))
    (tmp_path / "text.onnx").write_text("no network")
    with pytest.raises(PerceptionError, match=r"text\.onnx can't be loaded"):
        DepthNetwork(tmp_path / "text.onnx")
    with pytest.raises(PerceptionError, match=r"no file .*none\.onnx.*training/depth/README\.md"):
        DepthNetwork(tmp_path / "none.onnx")


def test_a_picture_of_another_size_than_its_camera_is_refused(network: DepthNetwork) -> None:
    camera, T = Pinhole.from_hfov(64, 48, 1.5), camera_pose((0, 0, 2.0), 0, DOWN_RAD)
    for wrong in (np.zeros((64, 48, 3), np.uint8), np.zeros((48, 64, 3), np.float32), np.zeros((48, 64), np.uint8)):
        with pytest.raises(PerceptionError, match=r"\(H, W, 3\) uint8 of its camera's 64 x 48 pixels"):
            network.estimate(wrong, camera, T, 0.0)  # type: ignore[arg-type]


def test_the_card_is_that_of_the_file() -> None:
    card = json.loads(BUILT_IN.with_name("card.json").read_text(encoding="utf-8"))
    data = BUILT_IN.read_bytes()
    assert card["sha256"] == hashlib.sha256(data).hexdigest()
    assert card["bytes"] == len(data) <= 4_000_000
