"""Another's depth network behind the interface: corrected by the floor, with an uncertainty, and unknown before a fit."""

from __future__ import annotations

import math
import threading
from pathlib import Path

import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.perception.depth.estimate import MAX_SIGMA_LOG
from surveilnav.perception.depth.fitted import OFF_FLOOR_SIGMA, FittedDepth
from surveilnav.perception.depth.onnx_model import OnnxDepth
from surveilnav.perception.depth.reference import reference_depth
from surveilnav.perception.parts import load_depth_model
from surveilnav.perception.runtime import Runtime

CAMERA = Pinhole.from_hfov(128, 96, 1.5)
T_WORLD_CAMERA = camera_pose((1.0, 2.0, 3.5), 0.7, math.radians(-35.0))
FLOOR_Z_M = 1.0
PICTURE = np.full((96, 128, 3), 90, np.uint8)


def cupboard_m() -> NDArray[np.float32]:
    """Depth of a floor, and of a cupboard at 2 m that fills the picture's middle."""
    depth_m = np.array(reference_depth(CAMERA, T_WORLD_CAMERA, FLOOR_Z_M).depth_m)
    depth_m[20:50, 40:80] = 2.0
    return depth_m


class Scripted:
    """A network that is wrong by a factor of 0.8 and by 0.1 m."""

    def __init__(self, true_m: NDArray[np.float32]) -> None:
        self.true_m = true_m

    def depth_m(self, rgb: NDArray[np.uint8]) -> NDArray[np.float32]:
        return np.asarray(0.8 * self.true_m - 0.1, np.float32)


def test_depth_is_corrected_and_the_floor_is_the_floor() -> None:
    said: list[str] = []
    estimator = FittedDepth(Scripted(cupboard_m()), said.append)
    estimate = estimator.estimate(PICTURE, CAMERA, T_WORLD_CAMERA, FLOOR_Z_M)
    reference = reference_depth(CAMERA, T_WORLD_CAMERA, FLOOR_Z_M)
    assert estimator.fit is not None
    assert estimate.depth_m[20:50, 40:80] == pytest.approx(2.0, rel=0.03)
    on_floor = reference.floor & (cupboard_m() == reference.depth_m)
    assert (estimate.floor[on_floor] > 0.5).all()
    assert (estimate.depth_m[on_floor] == reference.depth_m[on_floor]).all()
    assert not (estimate.floor[20:50, 40:80] > 0.5).any()
    assert (estimate.sigma_log >= OFF_FLOOR_SIGMA).all()
    depth_m, uncertainty = estimate.for_maps()
    assert uncertainty.sigma == pytest.approx(OFF_FLOOR_SIGMA, rel=0.2)
    assert 0.03 <= uncertainty.scale_sigma <= 0.1
    assert depth_m[60, 10] > 0
    assert said == [said[0]]
    assert "x 1.2" in said[0]


def test_before_a_fit_no_depth_is_known_and_a_fit_is_kept() -> None:
    network = Scripted(np.full((96, 128), 1.0, np.float32))  # something hangs before the camera
    estimator = FittedDepth(network)
    for _ in range(3):
        estimate = estimator.estimate(PICTURE, CAMERA, T_WORLD_CAMERA, FLOOR_Z_M)
        assert not estimate.depth_m.any()
        assert (estimate.sigma_log >= MAX_SIGMA_LOG).all()
    network.true_m = cupboard_m()
    for _ in range(6):
        estimator.estimate(PICTURE, CAMERA, T_WORLD_CAMERA, FLOOR_Z_M)
    assert estimator.fit is not None
    network.true_m = np.full((96, 128), 1.0, np.float32)
    for _ in range(40):
        estimate = estimator.estimate(PICTURE, CAMERA, T_WORLD_CAMERA, FLOOR_Z_M)
    assert np.median(estimate.depth_m) == pytest.approx(1.0, rel=0.05)


def test_what_is_black_counts_for_nothing() -> None:
    picture = PICTURE.copy()
    picture[:, :64] = 0  # a privacy zone
    true_m = cupboard_m()
    true_m[:, :64] = 1.0
    estimator = FittedDepth(Scripted(true_m))
    estimate = estimator.estimate(picture, CAMERA, T_WORLD_CAMERA, FLOOR_Z_M)
    assert not estimate.depth_m[:, :64].any()
    assert estimate.depth_m[20:50, 64:80] == pytest.approx(2.0, rel=0.03)


def test_several_threads_may_ask() -> None:
    estimator, failed = FittedDepth(Scripted(cupboard_m())), []

    def ask() -> None:
        try:
            for _ in range(5):
                estimator.estimate(PICTURE, CAMERA, T_WORLD_CAMERA, FLOOR_Z_M)
        except Exception as error:
            failed.append(error)

    threads = [threading.Thread(target=ask) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert not failed


def test_a_picture_of_another_size_is_refused() -> None:
    with pytest.raises(PerceptionError, match=r"128 x 96 pixels, got \(48, 64, 3\)"):
        FittedDepth(Scripted(cupboard_m())).estimate(PICTURE[::2, ::2], CAMERA, T_WORLD_CAMERA, FLOOR_Z_M)


# --- as an ONNX file ------------------------------------------------------------------------------------------------


def saved_onnx(path: Path, shape: list[int | str], rank_out: int = 3) -> Path:
    """A network whose depth is 2 m plus the mean of the normalised colours."""
    axes = helper.make_tensor("axes", TensorProto.INT64, [1], [1])
    two = helper.make_tensor("two", TensorProto.FLOAT, [], [2.0])
    nodes = [
        helper.make_node("ReduceMean", ["image", "axes"], ["mean"], keepdims=int(rank_out == 4)),
        helper.make_node("Add", ["mean", "two"], ["depth"]),
    ]
    graph = helper.make_graph(
        nodes,
        "depth",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, shape)],
        [helper.make_tensor_value_info("depth", TensorProto.FLOAT, [None] * rank_out)],
        [axes, two],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    return path


@pytest.mark.parametrize("shape", [[1, 3, 56, 70], [1, 3, "height", "width"]])
@pytest.mark.parametrize("rank_out", [3, 4])
def test_an_onnx_file_of_any_size_gives_depth_in_the_picture_s(
    tmp_path: Path, shape: list[int | str], rank_out: int
) -> None:
    model = load_depth_model(str(saved_onnx(tmp_path / "depth.onnx", shape, rank_out)), Runtime("cpu"))
    grey = np.zeros((96, 128, 3), np.uint8) + np.array([124, 116, 104], np.uint8)  # ImageNet's mean
    depth_m = model.depth_m(grey)
    assert depth_m.shape == (96, 128)
    assert depth_m == pytest.approx(2.0, abs=0.02)
    assert (model.depth_m(grey + np.uint8(60)) > 2.5).all()


def test_the_open_size_is_a_multiple_of_14_with_a_shorter_side_of_518(tmp_path: Path) -> None:
    model = OnnxDepth(saved_onnx(tmp_path / "depth.onnx", [1, 3, "height", "width"]), "m")
    assert model._input_size(1280, 720) == (924, 518)
    assert model._input_size(480, 640) == (518, 700)
    assert model._input_size(512, 512) == (518, 518)


def test_an_onnx_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    path = saved_onnx(tmp_path / "other.onnx", [1, 4, 56, 70])
    with pytest.raises(PerceptionError, match=r"expected a depth network with one input.*other\.onnx has inputs image"):
        load_depth_model(str(path), Runtime("cpu"))


def test_what_is_missing_is_said_with_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(tmp_path))
    with pytest.raises(PerceptionError, match=r"models pull depth-anything.*Apache-2\.0.*CC-BY-NC-4\.0.*DEPTH=network"):
        load_depth_model("depth-anything-v2-metric-indoor-small", Runtime("cpu"), download=False)
    with pytest.raises(PerceptionError, match=r"there is nothing.*SURVEILNAV_MODELS_DIR"):
        load_depth_model(str(tmp_path / "nothing.onnx"), Runtime("cpu"))
    with pytest.raises(PerceptionError, match="expected a depth network of depth_anything"):
        load_depth_model("compact", Runtime("cpu"), download=False)
