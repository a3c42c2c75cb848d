"""YOLO-World from a user's file, on files made here that answer what the test wants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole
from surveilnav.perception import presets
from surveilnav.perception.backend import ViewTask
from surveilnav.perception.detectors.yolo_world import YoloWorld, letterboxed
from surveilnav.perception.embedders.class_space import ClassSpace
from surveilnav.perception.protocols import RgbdView

WORDS = ["fire extinguisher", "samovar"]
SIDE = 64
CAMERA = Pinhole.from_hfov(64, 64, 1.2)


def export(
    path: Path, outputs: dict[str, np.ndarray], metadata: str = str(dict(enumerate(WORDS))), side: object = SIDE
) -> Path:
    """A file that gives these outputs whatever it is shown."""
    constants = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(array, name))
        for name, array in outputs.items()
    ]
    told = [
        helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(array.dtype), array.shape)
        for name, array in outputs.items()
    ]
    images = helper.make_tensor_value_info("images", TensorProto.FLOAT, [1, 3, side, side])
    model = helper.make_model(
        helper.make_graph(constants, "made-up", [images], told), opset_imports=[helper.make_opsetid("", 13)]
    )
    model.ir_version = 8
    if metadata:
        helper.set_model_props(model, {"names": metadata})
    onnx.save(model, path)
    return path


def dense(*rows: tuple[float, ...]) -> dict[str, np.ndarray]:
    """One output (1, 4 + W, N) of rows (cx, cy, w, h, score, score)."""
    return {"output0": np.array([rows], np.float32).transpose(0, 2, 1).reshape(1, 6, len(rows))}


def suppressed(*rows: tuple[float, float, float, float, float, int]) -> dict[str, np.ndarray]:
    """Four outputs of rows (x0, y0, x1, y1, score, label), and one row of rubbish behind the last."""
    padded = [*rows, (0.0, 0.0, 60.0, 60.0, 0.9, 1)]
    return {
        "num_dets": np.array([[len(rows)]], np.int32),
        "boxes": np.array([[r[:4] for r in padded]], np.float32),
        "scores": np.array([[r[4] for r in padded]], np.float32),
        "labels": np.array([[r[5] for r in padded]], np.int32),
    }


@pytest.mark.parametrize(
    "outputs",
    [
        dense((32, 32, 16, 8, 0.05, 0.9), (32.5, 32, 16, 8, 0.0, 0.8), (10, 40, 4, 4, 0.02, 0.03)),
        suppressed((24, 28, 40, 36, 0.9, 1), (5, 5, 9, 9, 0.01, 0)),
    ],
    ids=["one output", "four outputs"],
)
def test_a_box_in_the_file_is_one_in_the_picture(tmp_path: Path, outputs: dict[str, np.ndarray]) -> None:
    detector = YoloWorld(export(tmp_path / "mine.onnx", outputs), "mine@0")
    assert list(detector.vocabulary) == WORDS
    wide = np.zeros((60, 128, 3), np.uint8)  # shown at half its size, with 17 rows of grey above and below
    (found,) = detector.detect([wide], [["anything"]])
    assert found.labels == ["samovar"]
    np.testing.assert_allclose(found.xyxy, [[48, 22, 80, 38]], atol=1e-4)
    assert found.best_scores[0] == pytest.approx(0.9)


def test_a_picture_lies_in_the_middle_of_grey() -> None:
    rgb = np.full((20, 40, 3), (255, 128, 0), np.uint8)
    tensor, ratio, left, top = letterboxed(rgb, SIDE, SIDE)
    assert (tensor.shape, ratio, left, top) == ((1, 3, SIDE, SIDE), 1.6, 0.0, 16.0)
    np.testing.assert_allclose(tensor[0, :, 32, 32], [1.0, 128 / 255, 0.0])
    np.testing.assert_allclose(tensor[0, :, 15, 32], [114 / 255] * 3)
    np.testing.assert_allclose(tensor[0, :, 48, 32], [114 / 255] * 3)


def test_words_may_stand_beside_the_file(tmp_path: Path) -> None:
    path = export(tmp_path / "mine.onnx", dense((32, 32, 16, 8, 0.9, 0.1)), metadata="")
    with pytest.raises(PerceptionError, match=r"mine.txt beside it"):
        YoloWorld(path, "mine@0")
    path.with_suffix(".txt").write_text("Fire extinguisher\nSamovar\n\n")
    assert YoloWorld(path, "mine@0").detect([np.zeros((64, 64, 3), np.uint8)])[0].labels == ["fire extinguisher"]


@pytest.mark.parametrize(
    ("outputs", "metadata", "side", "said"),
    [
        (dense((32, 32, 16, 8, 0.9, 0.1)), "['a']", SIDE, "scores of 1 words"),
        (dense((32, 32, 16, 8, 0.9, 0.1)), "['sofa', 'couch']", SIDE, "each once"),
        (dense((32, 32, 16, 8, 0.9, 0.1)), "{0: 'samovar', 1: ' ', 2: 'bed'}", SIDE, "an empty one at place 1"),
        (dense((32, 32, 16, 8, 0.9, 0.1)), "import os", SIDE, "doesn't say which words"),
        (dense((32, 32, 16, 8, 0.9, 0.1)), str(WORDS), "height", "fixed sizes"),
        ({"num_dets": np.zeros((1, 1), np.int32), "x": np.zeros(1, np.float32)}, str(WORDS), SIDE, "boxes"),
    ],
)
def test_files_of_another_kind_are_refused(
    tmp_path: Path, outputs: dict[str, np.ndarray], metadata: str, side: object, said: str
) -> None:
    with pytest.raises(PerceptionError, match=said):
        YoloWorld(export(tmp_path / "mine.onnx", outputs, metadata, side), "mine@0").detect(
            [np.zeros((64, 64, 3), np.uint8)]
        )


@pytest.mark.parametrize(("threshold", "found"), [(None, 0), (0.0, 2), (0.04, 1)])
def test_a_threshold_of_nothing_is_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, threshold: float | None, found: int
) -> None:
    path = export(tmp_path / "mine.onnx", dense((32, 32, 16, 8, 0.05, 0.0), (10, 10, 8, 8, 0.03, 0.0)))
    monkeypatch.setattr(presets.parts, "load_embedder", lambda *_, **__: ClassSpace())
    backend = presets.yolo_world(presets.NetworkSettings(detector=str(path), threshold=threshold), "for tests")
    task = [ViewTask(RgbdView(np.zeros((64, 64, 3), np.uint8), np.zeros((64, 64), np.float32), CAMERA))]
    backend.stages[0].run(task)
    assert len(task[0].boxes.xyxy) == found
