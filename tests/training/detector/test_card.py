"""The card of ``compact``: what evaluation writes into it, and the page that is made of it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from surveilnav.errors import PerceptionError
from surveilnav.perception import models
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.models.card import Card, card_of, save_card
from surveilnav.simulator.world.labels import TARGETS
from training.detector import classes
from training.detector.card import page
from training.detector.evaluate import Tally, measured
from training.detector.views import TrainingView

PAGE = Path(__file__).parents[3] / "docs" / "understand" / "compact.md"
NAMES = classes.load().names


def test_the_page_is_made_of_the_card_in_the_package() -> None:
    path = models.model_called("compact").built_in_path
    card = card_of(path) if path.exists() else None
    assert PAGE.read_text(encoding="utf-8") == page(card), "`make docs` writes it"


def found() -> Card:
    """What an evaluation of two views says: the bed is found in the robot's, nothing in the camera's."""
    tallies = {(kind, name): Tally(NAMES, 1) for kind in ("robot", "camera") for name in ("compact", "yolox-nano")}
    boxes = np.array([[10, 10, 50, 50]], np.float32)
    for (kind, name), tally in tallies.items():
        view = TrainingView(
            kind,
            "flat",
            1.0,
            np.zeros((64, 64, 3), np.uint8),
            np.zeros((64, 64), np.float32),  # type: ignore[arg-type]
            np.zeros((64, 64), np.uint8),
            boxes,
            np.array([NAMES.index("bed")]),
            np.array([1600]),
            np.zeros(len(NAMES), bool),
            -1,
        )
        scores = np.zeros((1, len(NAMES)), np.float32)
        scores[0, NAMES.index("bed")] = 0.9
        right = (kind, name) == ("robot", "compact")
        tally.add(view, Boxes(boxes, scores, NAMES) if right else Boxes(boxes[:0], scores[:0], NAMES))
    said = measured("compact", tallies, {"robot": 0.8125}, {"robot": 1, "camera": 1})
    return Card("ab" * 32, 5_100_000, 1_270_000, 60_000, 960_000, said, {"compact": 8.8, "yolox-nano": 8.0})


def test_what_evaluation_finds_is_kept_beside_the_weights(tmp_path: Path) -> None:
    card = found()
    save_card(tmp_path / "compact.onnx", card)
    assert card_of(tmp_path / "compact.onnx") == card
    robot, camera = card.measured["robot"], card.measured["camera"]
    assert (robot.views, robot.ap50, robot.ap50_all, robot.mask_iou) == (
        1,
        pytest.approx(1.0, abs=0.01),
        robot.ap50,
        0.812,
    )
    assert robot.by_class == {"bed": robot.ap50}
    assert (camera.ap50, camera.mask_iou, camera.beside) == (0.0, 0.0, {"yolox-nano": 0.0})
    (tmp_path / "card.json").write_bytes(msgspec.json.encode({"sha256": 1}))
    with pytest.raises(PerceptionError, match="should be the card"):
        card_of(tmp_path / "compact.onnx")


def test_the_page_says_the_numbers_and_the_limits() -> None:
    text = page(found())
    assert "1.27 M parameters, 5.10 MB" in text
    assert "| robot views | 1 | 1.00 | 1.00 | 0.81 | `yolox-nano` 0.00 |" in text
    assert "| bed | 1.00 | 0.00 |" in text
    assert "`compact` 8.8 ms, `yolox-nano` 8.0 ms" in text
    assert "aren't in the package yet" not in text
    assert "not photographs" in text
    assert all(name in text for name in (*TARGETS, "chest of drawers", "meeting room"))
