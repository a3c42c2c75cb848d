"""The table and the picture of photographs, on boxes made up."""

from __future__ import annotations

import numpy as np
import pytest

from surveilnav.benchmark.studies import photographs
from surveilnav.benchmark.studies.photographs import PHOTOGRAPHS, Photograph, drawn, named, page, read
from surveilnav.errors import ConfigError
from surveilnav.perception.boxes import Boxes
from surveilnav.perception.vocabulary import COCO


def boxes(*found: tuple[str, float]) -> Boxes:
    scores = np.zeros((len(found), len(COCO)), np.float32)
    for row, (label, score) in zip(scores, found, strict=True):
        row[COCO.index(label)] = score
    return Boxes(np.tile(np.float32([10, 10, 50, 40]), (len(found), 1)), scores, COCO)


SHOWN = (Photograph("room", "p", "room.png", ("bed", "chair"), "CC0"), Photograph("sky", "p", "sky.png", (), "CC0"))


def test_each_name_counts_once_right_or_wrong():
    found = {"one": [boxes(("bed", 0.5), ("bed", 0.9), ("tv", 0.6)), boxes(("bed", 0.7))], "two": [Boxes.empty()] * 2}
    rows = page(found, SHOWN).splitlines()
    assert rows[0] == "| photograph | shows | one | two |"
    assert rows[2] == "| room | bed, chair | bed 0.90, tv 0.60 | – |"
    assert rows[3] == "| sky | nothing of COCO | bed 0.70 | – |"
    assert rows[4] == "| **right names, of 2** | | **1** | **0** |"
    assert rows[5] == "| **wrong names** | | **2** | **0** |"


def test_names_have_their_best_scores():
    assert named(boxes(("tv", 0.5), ("bed", 0.75), ("tv", 0.625))) == [("bed", 0.75), ("tv", 0.625)]


def test_a_cell_shows_the_box_where_it_is():
    cell = drawn(
        np.zeros((460, 600, 3), np.uint8),
        Boxes(np.float32([[100, 100, 400, 300]]), boxes(("tv", 0.5)).scores, COCO),
        "t",
    )
    assert cell.shape == (230, 300, 3)
    assert tuple(cell[150, 100]) == (255, 220, 0), "the lower edge, at half the size"
    assert tuple(cell[100, 100]) == (0, 0, 0)


def test_photographs_name_classes_and_licences():
    for photograph in PHOTOGRAPHS:
        assert set(photograph.shows) <= set(COCO)
        assert photograph.drawn == ("not stated" not in photograph.licence)


def test_a_photograph_that_is_not_here_is_named():
    assert read(next(p for p in PHOTOGRAPHS if p.package == "sklearn")).shape[2] == 3
    with pytest.raises(ConfigError, match=r"room.png of the package surveilnav.*scikit-image"):
        read(Photograph("room", "surveilnav", "room.png", (), ""))
    with pytest.raises(ConfigError, match="no_such_package"):
        read(Photograph("room", "no_such_package", "room.png", (), ""))


def test_detectors_find_what_photographs_of_this_environment_show(models_dir):
    admiral = next(p for p in PHOTOGRAPHS if p.name == "admiral")
    for name in set(photographs.detectors_here()) - {"compact"}:  # of people it knows next to nothing
        (found,) = photographs.boxes_of(name, [read(admiral)])
        assert dict(named(found))["person"] > 0.8


def test_compact_looks_at_photographs_without_depth():
    rng = np.random.default_rng(0)
    picture = np.kron(rng.integers(0, 255, (12, 16, 3)), np.ones((20, 20, 1))).astype(np.uint8)
    (found,) = photographs.boxes_of("compact", [picture])
    assert "bed" in found.words
    assert (found.best_scores >= photographs.LEAST_SCORE).all()
