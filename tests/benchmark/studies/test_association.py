"""Association without episodes: scores count right, replays are the map's own, the page is true to its records."""

from __future__ import annotations

import math

import numpy as np
import pytest

from surveilnav.benchmark.canary import digest
from surveilnav.benchmark.studies.association import run as association
from surveilnav.benchmark.studies.association.page import Results, choose, page
from surveilnav.benchmark.studies.association.replays import Player, good_detections, score, variants
from surveilnav.benchmark.studies.recordings import TOURS, Facts, Recording, SeenView, Thing
from surveilnav.geometry import Pinhole, camera_pose
from surveilnav.messages.maps import ObjectEvent, ObjectRecord
from surveilnav.perception.embedders.class_space import embed_image, embed_object
from surveilnav.sensing.views import DetectedObject, PosedView, ViewPerception
from surveilnav.services.fusion.core import FusionConfig, JointMap, ObjectConfig
from surveilnav.services.fusion.core.config import AssociationConfig, PointsConfig

THINGS = {
    1: Thing(1, "chair", "0", (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),
    2: Thing(2, "chair", "0", (2.0, 0.0, 0.0), (3.0, 1.0, 1.0)),
    3: Thing(3, "couch", "0", (5.0, 0.0, 0.0), (7.0, 1.0, 1.0)),
    4: Thing(4, "", "0", (8.0, 0.0, 0.0), (9.0, 1.0, 1.0)),
}


def made(id_, label, center_m, confirmed=()):
    history = [ObjectEvent(0, "robot/r", 0, 0, c, 0.5, "confirmed") for c in confirmed]
    return ObjectRecord(
        id=id_,
        floor="0",
        label=label,
        status="candidate",
        confidence=0.5,
        confidence_robot=0.5,
        confidence_surveillance=0.0,
        label_robot=label,
        label_surveillance="",
        n_detections=0,
        n_points=1,
        center_m=center_m,
        size_m=(1.0, 1.0, 1.0),
        first_seen_ns=0,
        last_seen_ns=0,
        sources=[],
        reason="",
        history=history,
    )


def test_what_counts_as_duplicate_wrong_merge_and_missed():
    found = [
        (made(1, "chair", (0.5, 0.5, 0.7), ["chair"]), [(1, 1.0)] * 4),
        (made(2, "bed", (0.5, 0.5, 0.5)), [(1, 0.8)] * 2),  # a duplicate, of a wrong name
        (made(3, "chair", (0.5, 0.5, 0.5)), [(1, 0.8)]),  # seen once: no object yet
        (made(4, "couch", (5.0, 0.5, 0.5), ["couch"]), [(3, 1.0)] * 7 + [(2, 1.0)] * 3),  # swallowed a chair
        (made(5, "bed", (9.0, 9.0, 0.5), ["bed"]), [(0, 1.0)] * 2),  # a wall
        (made(6, "couch", (7.2, 0.5, 0.5), ["couch"]), [(0, 1.0)] * 2),  # the wall right behind the couch
    ]
    got = score(THINGS, {1: 5, 2: 3, 3: 7, 4: 2}, found)
    assert got["things"] == [
        ["chair", 5, 2, 3, 1, 0, 0, 1, 0.2],
        ["chair", 3, 0, 0, 0, 0, 0, 1, None],
        ["couch", 7, 1, 1, 2, 0, 1, 1, 1.0],
    ]
    assert got["served"] == {
        "chair > chair": [1, 1],
        "bed > chair": [1, 0],
        "couch > couch": [2, 2],
        "bed > background": [1, 1],
    }
    assert score(THINGS, {1: 5, 2: 1}, found)["things"] == [["chair", 5, 2, 3, 1, 0, 0, 1, 0.2]]


@pytest.fixture
def recording():
    """Two boards before a wall, seen five times from the side, under one name."""
    camera = Pinhole.from_hfov(192, 144, math.radians(79))
    look = embed_object(np.eye(80)[56])
    views = []
    for seq in (3, 1, 2, 5, 4):
        depth_m = np.full((144, 192), 3.0, np.float32)
        depth_m[30:120, 15:75] = depth_m[30:120, 120:180] = 2.0
        boxes = [(15.0, 30.0, 75.0, 120.0), (120.0, 30.0, 180.0, 120.0)]
        said = ViewPerception(
            "test", tuple(DetectedObject("chair", 0.6, b, None, look) for b in boxes), embed_image([])
        )
        pose = camera_pose((0.0, 0.02 * seq, 0.88), 0.0, 0.0)
        view = PosedView(
            "robot/r1", 0, seq, seq, "0", pose, camera, 0.88, np.zeros((144, 192, 3), np.uint8), depth_m, (0.5, 5.0)
        )
        views.append(SeenView(view, said, ((1, 1.0), (2, 0.9))))
    return Recording(Facts("test", 3, "test", 5, ""), THINGS, views)


def test_a_replay_is_what_the_joint_map_does_with_the_same_views(recording):
    config = ObjectConfig()
    result = Player(recording).play(config)
    joint = JointMap(FusionConfig(objects=config))
    for seen in sorted(recording.views, key=lambda s: s.view.stamp_ns):
        joint.integrate(seen.view, seen.perception)
    assert [o for o, _ in result.objects] == joint.objects("0")
    assert [truths for _, truths in result.objects] == [[(1, 1.0)] * 5, [(2, 0.9)] * 5]
    assert len(result.cpu_ms) == 5
    assert result.shape_bytes > 0


def test_masks_become_points_once_for_all_ways_to_associate_them(recording):
    player = Player(recording)
    first = player.play(ObjectConfig())
    calls, locate = [], player._located
    player._located = lambda *settings: calls.append(settings) or locate(*settings)
    player.play(ObjectConfig(association=AssociationConfig(tau=0.7, geometry="box_iou")))
    player.play(ObjectConfig(points=PointsConfig(dbscan_eps_m=0.2)))
    assert calls[0] != calls[1]
    assert locate.cache_info().misses == 2
    assert [o for o, _ in player.play(ObjectConfig()).objects] == [o for o, _ in first.objects]


def records(recording, wanted):
    good = good_detections(recording)
    for variant in variants("sparse"):
        if (variant.group, variant.name) not in wanted:
            continue
        found = score(THINGS, good, Player(recording).play(variant.config).objects)
        if variant.name == "box_iou 0.7 eq. 3 alone":  # fewest errors, wrong names
            found["served"] = {"bed > chair": [2, 0]}
        yield {
            "home": "test",
            "perception": "test",
            "tour": "sparse",
            "program": digest(),
            "group": variant.group,
            "name": variant.name,
            "fingerprint": variant.fingerprint,
            "cpu_ms": [1.0, 1.0, 2.0],
            "first_last_ms": [1.0, 1.0],
            "locate_ms": 1.0,
            "objects": 2,
            "shape_bytes": 1000,
            "views": 5,
            **found,
        }


def test_the_page_and_the_choice(recording):
    wanted = {
        ("preset", "default"),
        ("preset", "paper"),
        ("sweep", "overlap 1.2 all rules"),
        ("sweep", "box_iou 0.7 eq. 3 alone"),
    }
    played = list(records(recording, wanted))
    old = played[0] | {"program": "that does otherwise", "things": []}
    results = Results("sparse", [*played, old, played[0] | {"tour": "dense", "things": []}])
    assert choose(results) == "overlap 1.2 all rules"
    text = page({"sparse": results}, "the command")
    assert "`the command`" in text
    assert "| **the default** | 0 (0; 0) | 0 / 0 | 0 | 0.00 [0.00, 0.00] | 100 % |" in text
    assert "It takes `overlap 1.2 all rules`" in text
    assert "The sparse tour wasn't played yet" in page({"sparse": Results("sparse", [])}, "")


def test_the_page_can_be_written_again_from_the_records_alone(recording, tmp_path):
    for r in records(recording, {("preset", "default"), ("preset", "paper"), ("sweep", "overlap 1.2 all rules")}):
        association.rows_in(tmp_path).append(r | {"perception": "onnx-coco"})
    arguments = [
        "--out",
        str(tmp_path / "out"),
        "--recordings",
        str(tmp_path),
        "--table",
        "--homes",
        "test",
        "--tours",
        "sparse",
    ]
    assert association.main(arguments) == 0
    assert "--tours sparse --homes test" in (tmp_path / "out" / "README.md").read_text()
    assert (tmp_path / "out" / "association.png").stat().st_size > 1000


def test_variants_have_names_of_their_own():
    for tour in TOURS:
        names = [(v.group, v.name) for v in variants(tour)]
        assert len(names) == len(set(names))
