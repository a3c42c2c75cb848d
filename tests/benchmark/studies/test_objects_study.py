"""The study of objects' chances, on a building of two things that was made up."""

from __future__ import annotations

import math
import zlib

import numpy as np
import pytest

from surveilnav.benchmark.studies.calibration import objects
from surveilnav.benchmark.studies.calibration.objects import Claim, claims_of, figures, precision_recall
from surveilnav.benchmark.studies.calibration.views import Found, Look, Looks
from surveilnav.geometry import Pinhole, Pose
from surveilnav.perception.chances import ChanceTable
from surveilnav.services.fusion.core import ObjectConfig

CAMERA = Pinhole.from_hfov(64, 48, 1.4)
TABLE = ChanceTable("even", 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, {})
CHAIR, SHELF = (8, 16, 24, 36), (40, 14, 56, 34)  # boxes in pixels
CONFIG = ObjectConfig()


def look(seq: int, found: list[Found], source: str = "robot/r") -> Look:
    """A chair and a shelf, 2 m before a wall at 4 m, seen from 0.88 m above the floor."""
    ids, depth_mm = np.zeros((48, 64), np.uint16), np.full((48, 64), 4000, np.uint16)
    for id_, (x0, y0, x1, y1) in ((1, CHAIR), (2, SHELF)):
        ids[y0:y1, x0:x1], depth_mm[y0:y1, x0:x1] = id_, 2000
    T = np.array([[0.0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, 0.88], [0, 0, 0, 1]])
    return Look(
        source,
        0,
        seq,
        Pose.from_matrix(T),
        CAMERA,
        zlib.compress(ids.tobytes()),
        zlib.compress(depth_mm.tobytes()),
        found,
        [],
    )


def found(label: str, box: tuple[int, ...], id_: int, score: float) -> Found:
    return Found(label, score, tuple(float(v) for v in box), id_, 1.0, 2.0)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def claims() -> list[Claim]:
    chair, false = found("chair", CHAIR, 1, 0.8), found("tv", SHELF, 2, 0.4)
    looks = [look(1, [chair], "camera/a"), *(look(i, [chair, false][: 1 + i % 2]) for i in range(1, 51))]
    return claims_of(3, Looks("made", {1: "chair", 2: "bookcase"}, looks), TABLE, CONFIG)


def test_what_the_map_claims_and_what_it_is(claims):
    facts = {(c.building, c.label, c.truth, c.right) for c in claims}
    assert facts == {(3, "chair", "chair", True), (3, "tv", "bookcase", False)}
    by_label = {label: [c for c in claims if c.label == label] for label in ("chair", "tv")}
    assert [len(of) for of in by_label.values()] == [3, 2], "after the cameras, after 25 views and after 50"
    assert {label: sum(c.weight for c in of) for label, of in by_label.items()} == {"chair": 1.0, "tv": 1.0}
    last = by_label["chair"][-1].evidence
    assert (last["robot"]["chair"][0], last["surveillance"]["chair"][0]) == (50, 1)


def test_it_is_judged_as_fusion_judges(claims):
    posterior = CONFIG.confirmation.posterior
    chance = objects.chances_of(claims, posterior, CONFIG.false_positives.size_mismatch_factor)
    right = np.array([c.right for c in claims])
    assert chance[right].min() > chance[~right].max()
    assert figures(chance, claims).auc == 1.0
    assert precision_recall(chance, claims, chance[right].min()) == (1.0, 1.0)
    assert objects.scores_of(claims) == pytest.approx(np.where(right, 0.8, 0.4))


def test_figures_are_those_of_the_literature():
    made = [Claim(0, "tv", truth, {}, False, w) for truth, w in (("tv", 1.0), ("", 0.5), ("", 0.5), ("tv", 1.0))]
    chance = np.array([0.7, 0.2, 0.75, 0.95])
    got = figures(chance, made)
    assert got.auc == pytest.approx((0.5 + 0.0 + 0.5 + 0.5) / 2.0)
    assert got.log_loss == pytest.approx(
        -(math.log(0.7) + 0.5 * math.log(0.8) + 0.5 * math.log(0.25) + math.log(0.95)) / 3
    )
    assert got.error == pytest.approx((abs(0.7 - 1 + 0.5 * 0.75) + 0.5 * 0.2 + 0.05) / 3)
    assert precision_recall(chance, made, 0.72) == pytest.approx((1.0 / 1.5, 1.0 / 2.0))


def test_the_fit_finds_what_repeats_are_worth(claims):
    """Where repeats are never wrong they come to be worth more, and the page says what came out."""
    others = [Claim(c.building + 1, c.label, c.truth, c.evidence, c.misfit, c.weight) for c in claims]
    both = [*claims, *others]
    fitted = objects.fitted(both, 0.7)
    chances = [objects.chances_of(both, config, 0.7) for config in (CONFIG.confirmation.posterior, fitted)]
    before, after = (figures(chance, both).log_loss for chance in chances)
    assert after <= before
    left_out = objects.left_out(both, 0.7)
    assert left_out[: len(claims)] == pytest.approx(objects.chances_of(claims, objects.fitted(others, 0.7), 0.7))
    text = objects.page(both, CONFIG, fitted, left_out, "made up")
    assert "Source: made up." in text
    assert all(f"| {label} | 2 |" in text for label in ("chair", "tv"))
    assert "| bed |" not in text
