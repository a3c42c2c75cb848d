"""What this package has of weights, if any: whole, small, and what its card says."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surveilnav.geometry import Pinhole
from surveilnav.perception import models
from surveilnav.perception.models.catalogue import BUILT_IN
from surveilnav.perception.presets import PRESETS, NetworkSettings
from surveilnav.simulator.world.labels import TARGETS

ROOT = Path(__file__).parents[4]
COMPACT = BUILT_IN / "compact" / "compact.onnx"
there = pytest.mark.skipif(not COMPACT.exists(), reason="the weights of compact aren't in the package yet")


@there
def test_the_weights_are_small_and_have_a_card():
    card = models.card_of(COMPACT)
    assert card is not None, "`python -m training.detector.export` writes card.json beside the weights"
    assert card.bytes == COMPACT.stat().st_size <= 8_000_000
    assert models.survey("compact").fault == ""
    assert 0 < card.parameters <= 1_500_000
    assert set(card.measured) == {"robot", "camera"}, "`python -m training.detector.evaluate --card` adds them"


@there
def test_the_docs_know_that_they_are_there():
    pages = [*ROOT.glob("docs/**/*.md"), ROOT / "training" / "detector" / "README.md"]
    said = [str(page.relative_to(ROOT)) for page in pages if "in the package yet" in page.read_text(encoding="utf-8")]
    assert said == [], "these pages say that the weights aren't there"
    assert "data/compact" in (ROOT / "CREDITS.md").read_text(encoding="utf-8"), "a row for our own weights"


@there
def test_they_know_the_goals_and_the_parts_of_a_building_and_answer():
    backend = PRESETS["compact"](NetworkSettings(), "in a test")
    assert backend.vocabulary is not None
    assert len(backend.vocabulary) >= 40
    assert {*TARGETS, "door", "window", "stairs"} <= set(backend.vocabulary)
    assert backend.find_name("Fernseher") == "tv"
    assert backend.find_name("escalier") == "stairs"
    seen = backend.perceive(
        np.zeros((240, 320, 3), np.uint8), np.ones((240, 320), np.float32), Pinhole.from_hfov(320, 240, 1.3)
    )
    assert np.linalg.norm(seen.image_embedding) == pytest.approx(1.0, abs=1e-3)
