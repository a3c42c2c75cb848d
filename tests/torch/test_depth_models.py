"""Depth Anything: loaded from a folder without a network, and as an ONNX file; its depth fitted to the floor."""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import transformers

from surveilnav.cameras_file import load_cameras
from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.perception import parts
from surveilnav.perception.depth.fitted import FittedDepth
from surveilnav.perception.parts import load_depth_model
from surveilnav.perception.runtime import Runtime
from surveilnav.services.camera_node.config import CameraSettings
from surveilnav.services.camera_node.real import _depth_estimator

CPU = Runtime("cpu")


def test_a_folder_gives_metres_in_the_picture_s_size(
    folder_of: Callable[..., Path], pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SURVEILNAV_OFFLINE", "1")
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    folder = folder_of("depth_anything")
    model = load_depth_model(str(folder), CPU)
    depth_m = model.depth_m(pictures[0])
    assert (depth_m.shape, depth_m.dtype) == ((120, 160), np.float32)
    assert (depth_m > 0).all()
    assert (depth_m < 20).all()  # the head's sigmoid times 20 m
    assert depth_m.std() > 0.01
    assert not np.allclose(depth_m, model.depth_m(pictures[1]))
    # As the library itself: processor, network, and the size of the picture again.
    images = transformers.AutoImageProcessor.from_pretrained(folder, backend="pil")
    network = transformers.AutoModelForDepthEstimation.from_pretrained(folder).eval()
    picture = cv2.resize(pictures[0], (70, 56), interpolation=cv2.INTER_AREA)  # enlarging differs: bilinear, bicubic
    with torch.inference_mode():
        out = network(pixel_values=images([picture], return_tensors="pt")["pixel_values"])
    theirs = images.post_process_depth_estimation(out, target_sizes=[(56, 70)])[0]["predicted_depth"].numpy()
    assert model.depth_m(picture) == pytest.approx(theirs, rel=1e-4)
    assert images([pictures[0]], return_tensors="pt")["pixel_values"].shape == (1, 3, 56, 70)


def test_an_onnx_file_says_the_same(folder_of: Callable[..., Path], pictures: list[np.ndarray]) -> None:
    file = folder_of("depth_anything_onnx")
    by_folder, by_file = load_depth_model(str(file.parent), CPU), load_depth_model(str(file), CPU)
    picture = cv2.resize(pictures[0], (70, 56), interpolation=cv2.INTER_AREA)  # neither has to scale it
    assert np.abs(by_file.depth_m(picture) / by_folder.depth_m(picture) - 1).max() < 1e-3
    assert by_file.depth_m(pictures[0]).shape == (120, 160)


def test_a_relative_model_is_refused(folder_of: Callable[..., Path]) -> None:
    with pytest.raises(PerceptionError, match=r"expected a metric model.*holds a relative one.*Metric in it"):
        load_depth_model(str(folder_of("depth_anything", kind="relative")), CPU)


def test_another_model_is_refused(folder_of: Callable[..., Path]) -> None:
    with pytest.raises(PerceptionError, match=r"expected a depth network of depth_anything, and .* is 'clip'"):
        load_depth_model(str(folder_of("clip")), CPU)


def test_half_a_folder_is_refused(folder_of: Callable[..., Path], tmp_path: Path) -> None:
    half = tmp_path / "half"
    shutil.copytree(folder_of("depth_anything"), half)
    (half / "model.safetensors").unlink()
    with pytest.raises(PerceptionError, match=r"has no weights.*Apache-2\.0.*CC-BY-NC-4\.0"):
        load_depth_model(str(half), CPU)


def test_without_pytorch_it_says_what_to_install(
    folder_of: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    def missing() -> None:
        raise ImportError("No module named 'torch'")

    monkeypatch.setattr(parts, "_DEPTH", {"depth_anything": missing})
    with pytest.raises(PerceptionError, match=r"pip install 'surveilnav\[perception-torch\]'.*CAMERA__DEPTH=network"):
        load_depth_model(str(folder_of("depth_anything")), CPU)


def test_an_untrained_network_finds_no_floor_and_gives_no_depth(
    folder_of: Callable[..., Path], pictures: list[np.ndarray]
) -> None:
    said: list[str] = []
    estimator = FittedDepth(load_depth_model(str(folder_of("depth_anything")), CPU), said.append)
    camera, T = Pinhole.from_hfov(160, 120, 1.5), camera_pose((0.0, 0.0, 2.5), 0.0, math.radians(-35.0))
    for i in range(20):
        estimate = estimator.estimate(pictures[i % 8], camera, T, 0.0)
        assert not estimate.depth_m.any()
        assert not estimate.for_maps()[0].any()
    assert len(said) == 1
    assert "too little of the floor" in said[0]


def test_a_camera_node_runs_it(folder_of: Callable[..., Path], tmp_path: Path) -> None:
    (tmp_path / "cameras.yaml").write_text(
        "floors: {ground: {z_m: 0.0}}\ncameras:\n  - {name: hall, floor: ground, stream: usb:0, position_m: [0, 0, 2.5], "
        "yaw_deg: 0, pitch_deg: -35, lens: {width_px: 160, height_px: 120, hfov_deg: 86}}\n"
    )
    entry = load_cameras(tmp_path / "cameras.yaml").cameras["hall"]
    settings = CameraSettings(depth="depth-anything", depth_model=str(folder_of("depth_anything")))
    estimator = _depth_estimator(settings, entry, 0.0, lambda _: None)
    assert isinstance(estimator, FittedDepth)
