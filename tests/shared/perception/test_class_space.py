"""Closed-set embeddings: what the cosine means."""

from __future__ import annotations

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.errors import TargetError
from surveilnav.perception.embedders import class_space
from surveilnav.perception.vocabulary import COCO, DATA
from surveilnav.simulator.world.labels import TARGETS


def seen(**classes: float) -> list[np.ndarray]:
    rows = []
    for name, score in classes.items():
        row = np.zeros(len(COCO), np.float32)
        row[COCO.index(name.replace("_", " "))] = score
        rows.append(row)
    return rows


def test_presence_is_what_an_image_was_embedded_from() -> None:
    image = class_space.embed_image([*seen(bed=0.5), *seen(bed=0.5, tv=0.1)])
    expected = dict.fromkeys(COCO, 0.0) | {"bed": 0.75, "tv": 0.1}
    assert class_space.presence(image).tolist() == pytest.approx([expected[name] for name in COCO], abs=1e-6)


def relevance(target: str, **classes: float) -> float:
    text = class_space.embed_texts([f"seems like there is a {target}"])[0]
    return float(text @ class_space.embed_image(seen(**classes)))


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_cosine_of_objects_is_the_bhattacharyya_coefficient(seed: int) -> None:
    p, q = np.random.default_rng(seed).dirichlet(np.ones(len(COCO)), 2).astype(np.float32)
    cosine = class_space.embed_object(0.7 * p) @ class_space.embed_object(0.2 * q)
    assert cosine == pytest.approx(sum(np.sqrt(a * b) for a, b in zip(p, q, strict=True)), abs=1e-5)


def test_all_embeddings_are_unit_vectors_of_one_space() -> None:
    vectors = [
        class_space.embed_object(np.zeros(80)),
        class_space.embed_object(seen(bed=0.3)[0]),
        class_space.embed_image([]),
        class_space.embed_image(seen(bed=1.0, tv=0.2)),
        *class_space.embed_texts(list(COCO)),
    ]
    for vector in vectors:
        assert vector.shape == (class_space.DIM,)
        assert vector.dtype == np.float32
        assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-5)
    assert class_space.embed_texts([]).shape == (0, class_space.DIM)


@pytest.mark.parametrize(
    ("target", "best", "fair", "poor"),
    [
        ("tv", "tv", "couch", "toilet"),
        ("couch", "couch", "tv", "toilet"),
        ("toilet", "toilet", "sink", "couch"),
        ("bed", "bed", "laptop", "oven"),
    ],
)
def test_seeing_beats_neighbours_beat_nothing_beats_the_wrong_room(
    target: str, best: str, fair: str, poor: str
) -> None:
    direct, near, unknown, far = (relevance(target, **seen_) for seen_ in ({best: 0.8}, {fair: 0.8}, {}, {poor: 0.8}))
    assert direct > 2 * near
    assert near > 1.2 * unknown
    assert unknown > 1.2 * far


def test_surer_sight_of_the_target_is_worth_more() -> None:
    values = [relevance("potted plant", potted_plant=s) for s in (0.0, 0.1, 0.3, 0.6, 0.9)]
    assert values == sorted(values)
    assert values[-1] > 0.8


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("seems like there is a tv", "tv"),
        ("Seems like there is an oven.", "oven"),
        ("sofa", "couch"),
        ("it seems like there is a potted plant", "potted plant"),
        ("Television", "tv"),
    ],
)
def test_texts_name_classes(text: str, name: str) -> None:
    assert class_space.class_named(text) == name


def test_an_unknown_class_is_the_users_mistake() -> None:
    with pytest.raises(TargetError, match="fire extinguisher"):
        class_space.embed_texts(["seems like there is a fire extinguisher"])


def test_the_table_knows_every_usual_target_and_says_where_it_comes_from() -> None:
    table = json.loads((DATA / "coco" / "rooms.json").read_text())
    assert set(TARGETS) <= set(table["weights"]) <= set(COCO)
    assert "ProcTHOR" in table["source"]
    assert all(
        len(row) == len(table["rooms"]) and set(row) <= {0, 1, 2} and any(row) for row in table["weights"].values()
    )
