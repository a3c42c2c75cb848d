"""What surrounds the network in its ONNX file, on a tiny one: letterbox, places, the backend, files of other kinds."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from surveilnav.errors import PerceptionError
from surveilnav.geometry import Pinhole
from surveilnav.perception.chances import ChanceTable
from surveilnav.perception.detectors.compact import CompactNetwork, letterboxed, place_centres
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.single_network import SingleNetworkBackend
from surveilnav.sensing.views import box_cells
from tests.compact_file import write


@pytest.mark.parametrize(
    ("size", "box"),
    [((480, 640), (320, 416)), ((1280, 1280), (416, 416)), ((100, 50), (416, 224)), ((240, 320), (320, 416))],
)
def test_the_longer_side_fits_and_both_are_multiples_of_32(size: tuple[int, int], box: tuple[int, int]) -> None:
    out, ratio = letterboxed(np.full((*size, 3), 200, np.uint8), 416)
    assert out.shape == (*box, 3)
    rows, columns = (round(side * ratio) for side in size)
    assert max(rows, columns) == 416
    assert (out[:rows, :columns] == 200).all()
    assert (out[rows:] == 114).all()
    assert (out[:, columns:] == 114).all()


def test_places_are_the_middles_of_their_cells() -> None:
    points = place_centres(64, 96)
    assert len(points) == 8 * 12 + 4 * 6 + 2 * 3
    assert points[[0, 1, 12, 96, -1]].tolist() == [[4, 4], [12, 4], [4, 12], [8, 8], [80, 48]]


CAMERA = Pinhole.from_hfov(320, 240, 1.3)


def red_square() -> np.ndarray:
    """A picture (240, 320, 3) whose pixels [100:160, 100:180] are red."""
    rgb = np.full((240, 320, 3), 20, np.uint8)
    rgb[100:160, 100:180] = (255, 0, 0)
    return rgb


@pytest.fixture
def network(tmp_path: Path) -> CompactNetwork:
    return opened(write(tmp_path / "compact.onnx"))


def opened(path: Path) -> CompactNetwork:
    return CompactNetwork(open_session(path, Runtime()), side_px=320)


def test_as_a_backend_it_says_what_is_where_with_a_mask_and_a_vector(network: CompactNetwork) -> None:
    backend = SingleNetworkBackend("compact", "in a test", network, "compact@0")
    seen = backend.perceive(red_square(), np.ones((240, 320), np.float32), CAMERA)
    assert {d.label for d in seen.detections} == {"tv"}
    for d in seen.detections:
        x0, y0, x1, y1 = box_cells(d.box_px, 320, 240)
        assert d.mask is not None
        is_red = red_square()[y0:y1, x0:x1, 0] == 255
        assert (d.mask == is_red).mean() > 0.8
        assert np.linalg.norm(d.embedding) == pytest.approx(1.0, abs=1e-3)
        assert d.chance is None
    assert seen.words == network.classes
    assert not backend.calibrated


def test_with_a_table_its_detections_have_chances(network: CompactNetwork) -> None:
    table = ChanceTable("a test", 0.0, 1.0, 0.0, 0.0, 0.0, -1.0, {})
    backend = SingleNetworkBackend("compact", "in a test", network, "compact@0", table)
    depth = np.ones((240, 320), np.float32)
    robot, camera = (
        backend.perceive(red_square(), depth, CAMERA, key=(source, 0, 1)).detections
        for source in ("robot/r1", "camera/c1")
    )
    assert backend.calibrated
    assert [d.chance for d in robot] > [d.chance for d in camera] > [0.0]


def test_its_words_are_understood_and_rooms_have_near_classes(network: CompactNetwork) -> None:
    backend = SingleNetworkBackend("compact", "in a test", network, "compact@0")
    assert [backend.find_name(word) for word in ("Kommode", "Bett", "télé", "Couchtisch")] == [
        "chest of drawers",
        "bed",
        "tv",
        "",
    ]
    assert (backend.embed_texts(["Bett"]) == backend.embed_texts(["bed"])).all()
    assert "nearest are oven" in backend.refusal("kitchen")
    assert "nearest are table" in backend.refusal("Couchtisch")


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"classes": None}, "classes"),
        ({"classes": "tv"}, "classes"),
        ({"classes": ["TV", "bed", "chest of drawers", "table", "oven"]}, "spelled as words are"),
        ({"classes": ["tv", "tv", "chest of drawers", "table", "oven"]}, "one name"),
        ({"classes": []}, "1 to 4096 classes"),
        ({"near_vectors": [[1.0] * 8]}, "5 and 7 vectors"),
        ({"class_vectors": [[1.0]] * 4 + [[]]}, "5 and 7 vectors"),
        ({"class_vectors": [["a"]]}, "metadata can't be read"),
        ({"meanings": ["chest"]}, "metadata can't be read"),
    ],
)
def test_a_file_that_is_none_of_its_kind_is_refused(tmp_path: Path, more: dict[str, object], said: str) -> None:
    with pytest.raises(PerceptionError, match=said):
        opened(write(tmp_path / "compact.onnx", more=more))


def test_a_network_of_another_kind_is_refused(tmp_path: Path) -> None:
    value = helper.make_tensor_value_info
    graph = helper.make_graph(
        [helper.make_node("Identity", ["x"], ["y"])],
        "other",
        [value("x", TensorProto.FLOAT, [1])],
        [value("y", TensorProto.FLOAT, [1])],
    )
    path = tmp_path / "other.onnx"
    path.write_bytes(
        helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8).SerializeToString()
    )
    with pytest.raises(PerceptionError, match="no output scores"):
        opened(path)


def test_a_network_that_sees_no_depth_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "compact.onnx")
    model = onnx.load(path)
    del model.graph.input[1]
    path.write_bytes(model.SerializeToString())
    with pytest.raises(PerceptionError, match="no input depth"):
        opened(path)


def test_depth_lies_where_its_picture_lies(network: CompactNetwork, monkeypatch: pytest.MonkeyPatch) -> None:
    """Half of the view's right side is near; so is the same half of the letterbox, and what fills it up has no depth."""
    given: list[dict[str, np.ndarray]] = []
    run = network._session.run
    monkeypatch.setattr(network, "_session", SimpleNamespace(run=lambda out, x: given.append(x) or run(out, x)))
    depth = np.full((500, 640), 4.0, np.float32)
    depth[:, 320:] = 1.0
    network.run(RgbdView(np.zeros((500, 640, 3), np.uint8), depth, Pinhole.from_hfov(640, 500, 1.3)))
    channels = given[0]["depth"][0]
    assert channels.shape == (128, 160, 7)
    assert (channels[125:] == 0).all()
    assert channels[:124, :79, 1] == pytest.approx(0.25)
    assert channels[:124, 81:, 1] == pytest.approx(1.0)


@pytest.mark.parametrize(("size", "seen"), [((480, 640), (256, 320)), ((1280, 1280), (416, 416))])
def test_of_a_large_picture_more_pixels_are_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, size: tuple[int, int], seen: tuple[int, int]
) -> None:
    network, fed = CompactNetwork(open_session(write(tmp_path / "compact.onnx"), Runtime())), []
    session_ = network._session

    def run(outputs: object, inputs: dict[str, np.ndarray]) -> object:
        fed.append(inputs["picture"].shape[1:3])
        return session_.run(outputs, inputs)

    monkeypatch.setattr(network, "_session", SimpleNamespace(run=run))
    height, width = size
    view = RgbdView(
        np.zeros((height, width, 3), np.uint8), np.ones(size, np.float32), Pinhole.from_hfov(width, height, 1.3)
    )
    network.run(view)
    assert fed == [seen]
