"""The network: its shapes and budget, assignment and losses against slow literal code, its ONNX file."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from surveilnav.geometry import Pinhole
from surveilnav.perception.boxes import overlaps
from surveilnav.perception.detectors.compact import CompactNetwork, letterboxed, place_centres
from surveilnav.perception.detectors.depth_channels import N_CHANNELS, depth_channels
from surveilnav.perception.detectors.guided_mask import guided_mask
from surveilnav.perception.detectors.onnx_file import open_session
from surveilnav.perception.models.card import card_of
from surveilnav.perception.protocols import RgbdView
from surveilnav.perception.runtime import Runtime
from surveilnav.perception.single_network import SingleNetworkBackend
from surveilnav.sensing.views import box_cells
from training.detector import classes
from training.detector.assign import Targets, assign, pairwise_iou
from training.detector.export import export, write_card
from training.detector.losses import giou, in_boxes
from training.detector.network import Branch, Compact, boxes_of, places
from training.learning import n_parameters

NAMES = classes.load()
C, R = len(NAMES.names), len(NAMES.rooms)


@pytest.fixture(scope="module")
def network() -> Compact:
    """Untrained, but every layer has a say."""
    torch.manual_seed(0)
    network = Compact(C, R).eval()
    for module in network.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.weight, 0.5, 1.5)
    return network


def some_view(seed: int) -> RgbdView:
    """90 x 60 pixels of noise, 1 to 3 m away."""
    rng = np.random.default_rng(seed)
    rgb = rng.integers(0, 255, (60, 90, 3)).astype(np.uint8)
    return RgbdView(rgb, rng.uniform(1.0, 3.0, (60, 90)).astype(np.float32), Pinhole.from_hfov(90, 60, 1.2))


def test_each_stride_has_its_own_statistics() -> None:
    """The head is used with the statistics that it learnt by: else what it says changes between learning and use."""
    torch.manual_seed(0)
    branch = Branch(8, 2)
    levels = [scale * torch.randn(4, 8, 16, 16) + scale for scale in (0.1, 1.0, 10.0)]
    for _ in range(200):
        learning = [branch(x, level) for level, x in enumerate(levels)]
    branch.eval()
    for level, x in enumerate(levels):
        torch.testing.assert_close(branch(x, level), learning[level], atol=0.05, rtol=0.05)


def test_it_keeps_its_budget(network: Compact) -> None:
    assert n_parameters(network) <= 1_500_000


@pytest.mark.parametrize(("height", "width"), [(64, 96), (128, 64)])
def test_shapes(network: Compact, height: int, width: int) -> None:
    output = network(torch.rand(2, 3, height, width), torch.rand(2, N_CHANNELS, height // 2, width // 2))
    L = sum(height // s * (width // s) for s in (8, 16, 32))
    assert output.logits.shape == (2, L, C)
    assert output.ltrb.shape == (2, L, 4)
    assert (output.ltrb > 0).all()
    assert output.prototypes.shape[2:] == (height // 4, width // 4)
    assert output.coefficients.shape == (2, L, output.prototypes.shape[1])
    assert output.near.shape == (2, C + R)
    torch.testing.assert_close(output.embeddings.norm(dim=-1), torch.ones(2, L))
    assert (place_centres(height, width) == places(height, width)[0].numpy()).all()


def random_boxes(n: int, seed: int) -> Tensor:
    low = torch.rand(n, 2, generator=torch.Generator().manual_seed(seed)) * 60
    return torch.cat([low, low + 5 + 40 * torch.rand(n, 2, generator=torch.Generator().manual_seed(seed + 1))], dim=1)


def literal_giou(a: list[float], b: list[float]) -> tuple[float, float]:
    """(IoU, generalised IoU)."""
    w, h = max(0.0, min(a[2], b[2]) - max(a[0], b[0])), max(0.0, min(a[3], b[3]) - max(a[1], b[1]))
    union = (a[2] - a[0]) * (a[3] - a[1]) + (b[2] - b[0]) * (b[3] - b[1]) - w * h
    around = (max(a[2], b[2]) - min(a[0], b[0])) * (max(a[3], b[3]) - min(a[1], b[1]))
    return w * h / union, w * h / union - (around - union) / around


def test_overlaps_are_what_their_papers_say() -> None:
    a, b = random_boxes(20, 1), random_boxes(20, 3)
    wanted = torch.tensor([literal_giou(x, y) for x, y in zip(a.tolist(), b.tolist(), strict=True)])
    torch.testing.assert_close(pairwise_iou(a[None], b[None])[0].diagonal(), wanted[:, 0])
    torch.testing.assert_close(giou(a, b), wanted[:, 1])


def test_the_best_places_inside_answer_and_a_tiny_object_gets_one() -> None:
    points, _ = places(64, 96)
    boxes = boxes_of(torch.full((1, len(points), 4), 16.0), points)
    targets = Targets(
        torch.tensor([[[10.0, 10, 50, 50], [70, 20, 72, 22], [0, 0, 0, 0]]]),
        torch.tensor([[2, 1, 0]]),
        torch.tensor([[True, True, False]]),
    )
    logits = torch.zeros(1, len(points), 5)
    assigned = assign(logits, boxes, points, targets)
    owners = assigned.owner[assigned.positive]
    assert (owners == 0).sum() == 10
    assert (owners == 1).sum() == 1
    assert (owners == 2).sum() == 0
    at = points[assigned.positive[0]][owners == 0]
    assert ((at > 10) & (at < 50)).all()
    iou = pairwise_iou(targets.boxes, boxes)[0]
    assert assigned.quality.max() == pytest.approx(float(iou[0].max()))
    assert float(assigned.quality[0, assigned.best[0, 0]]) == pytest.approx(float(iou[0].max()))
    assert (assigned.quality[~assigned.positive] == 0).all()


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_place_answers_for_one_object_the_one_that_it_overlaps_most(order: tuple[int, int]) -> None:
    points, _ = places(64, 64)
    boxes = boxes_of(torch.full((1, len(points), 4), 12.0), points)
    two = torch.tensor([[[8.0, 8, 40, 40], [4, 4, 60, 60]]])[:, list(order)]
    targets = Targets(two, torch.tensor([[0, 0]]), torch.ones(1, 2, dtype=torch.bool))
    assigned = assign(torch.zeros(1, len(points), 2), boxes, points, targets)
    iou, small = pairwise_iou(two, boxes)[0], order.index(0)
    answers = assigned.positive[0] & (assigned.owner[0] == small)
    assert answers.sum() == 10
    assert (iou[small, answers] >= iou[1 - small, answers]).all()


def test_masks_are_looked_at_inside_their_boxes() -> None:
    inside = in_boxes(torch.tensor([[1.0, 0.0, 3.0, 2.0]]), 3, 4)
    assert inside[0].tolist() == [[0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 0]]


def test_its_file_says_what_it_says(network: Compact, tmp_path: Path) -> None:
    path = tmp_path / "compact.onnx"
    assert 4 * n_parameters(network) < export(network, path) <= 8_000_000
    view = some_view(0)
    own = CompactNetwork(open_session(path, Runtime()), side_px=96)
    answer = own.run(view)
    box, ratio = letterboxed(view.rgb, 96)
    assert box.shape == (64, 96, 3)
    depth = torch.zeros(1, N_CHANNELS, 32, 48)  # the picture fills all of the box's columns, all rows are its own, too
    depth[0] = torch.from_numpy(depth_channels(view.depth_m, view.camera, 48, 32)).permute(2, 0, 1)
    with torch.no_grad():
        output = network(torch.from_numpy(box).permute(2, 0, 1)[None].float() / 255.0, depth)
    assert own.classes == NAMES.names
    np.testing.assert_allclose(answer.scores, output.logits[0].sigmoid().numpy(), atol=1e-4)
    wanted = boxes_of(output.ltrb[0], places(*box.shape[:2])[0]).numpy() / ratio
    np.testing.assert_allclose(answer.xyxy, wanted, rtol=1e-3, atol=1e-2)
    np.testing.assert_allclose(answer.image, output.image[0].numpy(), atol=1e-4)
    np.testing.assert_allclose(answer.prototypes, output.prototypes[0].numpy(), atol=1e-3)


def test_its_card_says_what_its_weights_are(network: Compact, tmp_path: Path) -> None:
    path = tmp_path / "compact.onnx"
    export(network, path)
    card = write_card(path, network, steps=10, views_seen=160)
    assert card_of(path) == card
    assert (card.bytes, card.parameters) == (path.stat().st_size, n_parameters(network))
    assert card.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def file(network: Compact, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("onnx") / "compact.onnx"
    export(network, path)
    return path


def test_a_mask_is_that_of_its_place(file: Path) -> None:
    view = some_view(1)
    answer = CompactNetwork(open_session(file, Runtime()), side_px=96).run(view)
    logits = np.einsum("k,khw->hw", answer.coefficients[7], answer.prototypes).astype(np.float32)
    mask = answer.mask(7, (20, 12, 50, 40))
    assert mask.shape == (28, 30)
    assert (mask == guided_mask(logits, view.depth_m, (20, 12, 50, 40), answer.ratio / 4)).all()


def test_as_a_backend_it_answers_in_one_space(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("surveilnav.perception.single_network.MIN_SCORE", 0.0)
    network = CompactNetwork(open_session(file, Runtime()), side_px=96)
    backend = SingleNetworkBackend("compact", "in a test", network, "compact@0")
    view = some_view(2)
    seen = backend.perceive(view.rgb, view.depth_m, view.camera)
    assert seen.words == NAMES.names
    assert seen.detections
    best = network.run(view)
    tv, bed = backend.embed_texts(["seems like there is a TV", "bed"])
    vectors = np.stack([tv, bed, seen.image_embedding, *(d.embedding for d in seen.detections)])
    assert vectors.shape[1] == backend.embedding_dim == 128
    np.testing.assert_allclose(np.linalg.norm(vectors, axis=1), 1.0, atol=1e-3)
    wanted = best.image @ network.near_vectors[NAMES.names.index("tv")] / np.sqrt(2)
    assert seen.image_embedding @ tv == pytest.approx(wanted, abs=1e-4)
    for d in seen.detections:
        x0, y0, x1, y1 = box_cells(d.box_px, 90, 60)
        assert d.mask is None or d.mask.shape == (y1 - y0, x1 - x0)
    assert "nearest are couch" in backend.refusal("couches")
    assert backend.refusal("sofa") == ""
    words = ("Kommode", "Couchtisch", "escalier", "モニター", "table")
    assert [backend.find_name(word) for word in words] == ["chest of drawers", "table", "stairs", "computer", "table"]
    assert backend.find_name("kitchen") == ""
    assert len(backend.vocabulary.nearest("kitchen")) == 3


def test_one_thing_has_one_box_and_the_place_that_speaks_for_it(file: Path) -> None:
    network = CompactNetwork(open_session(file, Runtime()), side_px=96)
    answer = network.run(some_view(3))
    boxes, at = network.boxes(answer, 60, 90)
    assert len(boxes) == len(at) > 0
    assert (boxes.xyxy >= 0).all()
    assert (boxes.xyxy <= [90, 60, 90, 60]).all()
    np.testing.assert_allclose(np.clip(answer.xyxy[at], 0, [90, 60, 90, 60]), boxes.xyxy, atol=1e-4)
    iou, _ = overlaps(answer.xyxy[at], answer.xyxy[at])
    assert (iou[~np.eye(len(at), dtype=bool)] < 0.6).all()
