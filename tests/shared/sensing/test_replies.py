"""Replies of perception: what comes back is what was sent, and nothing else is understood."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest

from surveilnav.errors import WireError
from surveilnav.geometry import Pinhole
from surveilnav.messages import InferReply, ModelIds
from surveilnav.sensing.packing import pack_embedding
from surveilnav.sensing.replies import perception_from_wire, perception_to_wire
from surveilnav.sensing.views import DetectedObject, ViewPerception

CAMERA = Pinhole.from_hfov(64, 48, math.radians(79))


def unit(seed: int, dim: int = 8) -> np.ndarray:
    v = np.random.default_rng(seed).normal(size=dim).astype(np.float32)
    return v / np.linalg.norm(v)


def reply(**changes: object) -> InferReply:
    mask = np.random.default_rng(0).random((11, 21)) > 0.5
    seen = ViewPerception(
        "oracle",
        (
            DetectedObject("bed", 0.9, (10.2, 5.0, 30.5, 15.1), mask, unit(1), chance=0.25),
            DetectedObject("tv", 0.5, (0.0, 0.0, 64.0, 48.0), None, unit(2)),
        ),
        unit(3),
    )
    detections, image = perception_to_wire(seen)
    made = InferReply(
        stamp_ns=1,
        worker="w",
        backend="oracle",
        source="robot/r",
        view=0,
        seq=1,
        detections=detections,
        image_embedding=image,
        models=ModelIds(embedder="clip"),
        relevance={"bed": 0.5},
    )
    return msgspec.structs.replace(made, **changes)


def test_perception_round_trip() -> None:
    seen = perception_from_wire(reply(), CAMERA)
    assert [d.chance for d in seen.detections] == [0.25, None]
    assert [(d.label, d.score, d.box_px) for d in seen.detections] == [
        ("bed", 0.9, (10.2, 5.0, 30.5, 15.1)),
        ("tv", 0.5, (0.0, 0.0, 64.0, 48.0)),
    ]
    np.testing.assert_array_equal(seen.detections[0].mask, np.random.default_rng(0).random((11, 21)) > 0.5)
    assert seen.detections[1].mask is None
    np.testing.assert_allclose(seen.detections[0].embedding, unit(1), atol=1e-3)
    np.testing.assert_allclose(seen.image_embedding, unit(3), atol=1e-3)
    assert seen.embedding_model == "clip"


@pytest.mark.parametrize("relevance", [math.nan, 1.5, -math.inf])
def test_relevances_that_make_no_sense(relevance: float) -> None:
    with pytest.raises(WireError, match="relevance"):
        perception_from_wire(reply(relevance={"bed": relevance}), CAMERA)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"box_px": (math.nan, 0.0, 1.0, 1.0)}, "box"),
        ({"box_px": (30.0, 0.0, 10.0, 9.0)}, "box"),
        ({"box_px": (100.0, 0.0, 120.0, 9.0)}, "box"),
        ({"box_px": (10.2, 5.0, 40.0, 15.1)}, "mask"),
        ({"mask": [5, 5]}, "mask"),
        ({"score": 1.5}, "score"),
        ({"chance": 1.5}, "chance"),
        ({"chance": math.nan}, "chance"),
        ({"score": math.nan}, "score"),
        ({"label": ""}, "label"),
        ({"label": "x" * 1000}, "label"),
        ({"embedding": pack_embedding(unit(1, 7))}, "embedding"),
    ],
)
def test_detections_that_make_no_sense(changes: dict[str, object], word: str) -> None:
    honest = reply()
    bad = msgspec.structs.replace(honest.detections[0], **changes)
    with pytest.raises(WireError, match=word):
        perception_from_wire(reply(detections=[bad]), CAMERA)


def test_too_many_detections() -> None:
    with pytest.raises(WireError, match="detections"):
        perception_from_wire(reply(detections=reply().detections * 600), CAMERA)
