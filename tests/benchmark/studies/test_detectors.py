"""The evaluation counts right: hits, misses, confusions, false positives."""

from __future__ import annotations

import numpy as np

from surveilnav.benchmark.studies.detectors import ROBOT, RenderedView, Tally, matches
from surveilnav.perception.embedders.class_space import embed_object
from surveilnav.perception.vocabulary import COCO
from surveilnav.sensing.views import DetectedObject, TrueInstances
from surveilnav.simulator.truth.visible import VisibleThing


def detected(label: str, score: float, box: tuple[float, float, float, float]) -> DetectedObject:
    return DetectedObject(label, score, box, None, embed_object(np.eye(len(COCO))[COCO.index(label)]))


def thing(label: str, box: tuple[float, float, float, float]) -> VisibleThing:
    return VisibleThing(1, label, box, np.ones((1, 1), np.uint16), 1000, 1000, 2.0)


def test_a_thing_goes_to_its_own_class_first_and_only_once() -> None:
    things = [thing("bed", (0, 0, 100, 100)), thing("tv", (200, 0, 300, 100))]
    found = [
        detected("couch", 0.9, (0, 0, 100, 100)),
        detected("bed", 0.3, (5, 0, 100, 100)),
        detected("bed", 0.2, (0, 0, 95, 100)),
        detected("tv", 0.5, (260, 0, 360, 100)),
    ]
    assert matches(things, found) == [-1, 0, -1, -1]
    assert matches(things, found[:1]) == [0], "a confusion"
    assert matches([], found) == [-1] * 4
    assert matches(things, []) == []


def test_a_tally_of_one_hit_one_miss_one_confusion_one_invention() -> None:
    ids = np.zeros((480, 640), np.uint16)
    ids[100:200, 100:200], ids[100:200, 300:400], ids[300:400, 100:200], ids[0:10, 0:10] = 1, 2, 3, 4
    ids[300:400, 300:400] = 5
    truth = TrueInstances(ids, {1: "bed", 2: "tv", 3: "couch", 4: "chair", 5: "oven"})
    view = RenderedView(
        "v", "robot", np.zeros((480, 640, 3), np.uint8), np.full((480, 640), 2.0, np.float32), ROBOT, truth
    )
    tally = Tally(0.25, min_pixels=400)
    tally.add(
        view,
        [
            detected("bed", 0.8, (100, 100, 200, 200)),
            detected("bed", 0.6, (100, 300, 200, 400)),
            detected("chair", 0.4, (500, 300, 600, 400)),
            detected("chair", 0.1, (500, 0, 600, 100)),
            detected("chair", 0.4, (300, 300, 400, 400)),
        ],
    )
    assert dict(tally.objects) == {"bed": 1, "tv": 1, "couch": 1}, "a chair of 100 pixels is too small to count"
    assert tally.hits["bed"] == 1
    assert sum(tally.hits.values()) == 1
    assert dict(tally.confused) == {("couch", "bed"): 1, ("background", "chair"): 1, ("oven", "chair"): 1}
