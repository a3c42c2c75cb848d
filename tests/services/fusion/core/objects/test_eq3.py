"""Eq. 3 and what follows from it, against a slow reference that takes the paper at its word."""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Pinhole
from surveilnav.sensing.views import DetectedObject, PosedView
from surveilnav.services.fusion.core import FusionConfig, JointMap, ObjectConfig, in_order
from surveilnav.services.fusion.core.objects.association import similarity
from surveilnav.services.fusion.core.objects.config import AssociationConfig, FalsePositiveConfig
from surveilnav.services.fusion.core.objects.localization import LocatedDetection
from surveilnav.services.fusion.core.objects.object_map import ObjectMap
from surveilnav.services.fusion.core.objects.shape import Shape

FINE, COARSE = 1 / 32, 1 / 16  # [m], powers of two: no rounding decides whether boxes touch
CAMERA = Pinhole.from_hfov(32, 24, math.radians(79))


def only_eq3(**association):
    """Nothing but eq. 3 makes objects of detections."""
    return ObjectConfig(
        association=AssociationConfig(
            tau_mutual=None, once_per_view=False, merge_every=None, overlap_voxel_m=COARSE, **association
        ),
        false_positives=FalsePositiveConfig(size_prior=False),
    )


# --- the reference: lists, sets and loops ---------------------------------------------------------------------------


def voxels(points, size):
    return {tuple(math.floor(x / size) for x in p) for p in points}


def centres(cells):
    return [tuple((i + 0.5) * FINE for i in cell) for cell in sorted(cells)]


def reference_box_iou(a, b):
    """Axis-aligned boxes of the fine voxels."""
    inside = volume_a = volume_b = 1.0
    for k in range(3):
        a0, a1 = min(c[k] for c in a) * FINE, (max(c[k] for c in a) + 1) * FINE
        b0, b1 = min(c[k] for c in b) * FINE, (max(c[k] for c in b) + 1) * FINE
        inside *= max(0.0, min(a1, b1) - max(a0, b0))
        volume_a *= a1 - a0
        volume_b *= b1 - b0
    return inside / (volume_a + volume_b - inside)


def reference_voxel_iou(a, b):
    return len(a & b) / len(a | b)


def reference_overlap(a, b):
    """The larger of both shares of coarse voxels that have one of the other's among the 27 at and around them."""

    def share(one, other):
        beside = 0
        for c in one:
            beside += any(
                tuple(c[k] + d[k] for k in range(3)) in other for d in itertools.product((-1, 0, 1), repeat=3)
            )
        return beside / len(one)

    coarse_a, coarse_b = voxels(centres(a), COARSE), voxels(centres(b), COARSE)
    return max(share(coarse_a, coarse_b), share(coarse_b, coarse_a))


def reference_cosine(e, f):
    dot = sum(float(x) * float(y) for x, y in zip(e, f, strict=True))
    return dot / math.sqrt(sum(float(x) ** 2 for x in e) * sum(float(y) ** 2 for y in f))


GEOMETRIES = {"box_iou": reference_box_iou, "voxel_iou": reference_voxel_iou, "overlap": reference_overlap}


def reference_association(detections, geometry, w_visual, w_geometric, tau):
    """The object's number for each detection (points, embedding), and s by which it was chosen.

    Register a new object if s is lower than tau with all there are, else the most similar one (the first of equals).
    """
    objects, numbers, margins = [], [], []
    for points, embedding in detections:
        cells = voxels(points, FINE)
        best, best_s, all_s = None, -math.inf, []
        for number, (object_cells, embeddings) in enumerate(objects):
            mean = [sum(float(e[k]) for e in embeddings) / len(embeddings) for k in range(len(embedding))]
            s = w_visual * reference_cosine(embedding, mean) + w_geometric * GEOMETRIES[geometry](cells, object_cells)
            all_s.append(s)
            if s > best_s:
                best, best_s = number, s
        margins += [abs(s - tau) for s in all_s] + [a - b for a, b in itertools.pairwise(sorted(all_s, reverse=True))]
        if best is None or best_s < tau:
            objects.append((cells, [embedding]))
            best = len(objects) - 1
        else:
            objects[best] = (objects[best][0] | cells, [*objects[best][1], embedding])
        numbers.append(best)
    return numbers, objects, margins


# --- the same through the object map --------------------------------------------------------------------------------


def view(i=0, source="robot/r"):
    """A view whose picture no longer matters: its detections already have their place."""
    nothing = np.zeros((24, 32), np.float32)
    rgb = np.zeros((24, 32, 3), np.uint8)
    return PosedView(source, 0, i, i, "0", np.eye(4), CAMERA, 0.88, rgb, nothing, (0.5, 5.0))


def located(points, embedding, number=0, label="chair", score=0.5):
    box = (0.0, 0.0, float(number + 1), 1.0)  # tells detections apart in histories
    shape = Shape.from_points(np.array(points), FINE, COARSE)
    return LocatedDetection(DetectedObject(label, score, box, None, np.asarray(embedding, np.float32)), shape, 1.0)


def through_the_map(detections, config, floor_z_m=0.0):
    objects = ObjectMap("0", floor_z_m, FINE, config)
    for i, (points, embedding) in enumerate(detections):
        s = located(points, embedding, i)
        objects.add_located(view(i), (s.detection,), [s])
    numbers = {}
    for record in objects.records():
        numbers |= {round(event.box_px[2]) - 1: record.id - 1 for event in record.history if event.box_px}
    return [numbers[i] for i in range(len(detections))], objects


@st.composite
def scenes(draw):
    """Some detections: little clouds around a few places, some look alike."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    places = rng.uniform(-0.3, 0.3, (draw(st.integers(1, 3)), 3))
    looks = rng.uniform(0.0, 1.0, (2, 4)) + 0.05
    detections = []
    for _ in range(draw(st.integers(1, 7))):
        middle = places[rng.integers(len(places))] + rng.uniform(-0.1, 0.1, 3)
        points = middle + rng.uniform(-1, 1, (int(rng.integers(1, 40)), 3)) * rng.uniform(0.02, 0.2, 3)
        look = looks[rng.integers(2)] + rng.uniform(0, 0.2, 4)
        detections.append((points.tolist(), (look / np.linalg.norm(look)).astype(np.float32)))
    return detections


@pytest.mark.parametrize("geometry", GEOMETRIES)
@pytest.mark.parametrize("weights", [(1.0, 1.0), (0.7, 1.4), (1.0, 0.0)])
@given(scenes(), st.sampled_from([0.6, 0.98, 1.1, 1.35, 1.7]))
@settings(max_examples=40, deadline=None)
def test_detections_join_the_objects_that_the_paper_says(geometry, weights, detections, tau):
    wanted, objects, margins = reference_association(detections, geometry, *weights, tau)
    if min(margins, default=1.0) < 1e-5:  # a tie but for rounding: either is right
        return
    config = only_eq3(geometry=geometry, w_visual=weights[0], w_geometric=weights[1], tau=tau)
    got, made = through_the_map(detections, config)
    assert got == wanted
    for (cells, embeddings), obj in zip(objects, made._objects.values(), strict=True):
        # what fusion makes: the union of the points, the mean of the embeddings weighted by detections, renormalised
        assert set(map(tuple, np.floor(obj.shape.points / FINE).astype(int).tolist())) == cells
        mean = np.mean(embeddings, axis=0)
        np.testing.assert_allclose(
            obj.embedding_sum / np.linalg.norm(obj.embedding_sum), mean / np.linalg.norm(mean), atol=1e-5
        )


@pytest.mark.parametrize("geometry", GEOMETRIES)
@given(scenes())
@settings(max_examples=30, deadline=None)
def test_similarity_is_the_weighted_sum_and_symmetric(geometry, detections):
    config = only_eq3(geometry=geometry, w_visual=0.7, w_geometric=1.3)
    (p, e), (q, f) = detections[0], detections[-1]

    def s(points, embedding, other_points, other_embedding):
        one = through_the_map([(other_points, other_embedding)], config)[1]._objects[1]
        shape = Shape.from_points(np.array(points), FINE, COARSE)
        return similarity(shape, embedding, one.shape, one.embedding_sum, config.association).s

    there, back = s(p, e, q, f), s(q, f, p, e)
    assert there == pytest.approx(back, abs=1e-6)
    a, b = voxels(p, FINE), voxels(q, FINE)
    assert there == pytest.approx(0.7 * reference_cosine(e, f) + 1.3 * GEOMETRIES[geometry](a, b), abs=1e-5)


@pytest.mark.parametrize("geometry", GEOMETRIES)
@given(scenes(), st.tuples(*[st.integers(-400, 400)] * 3))
@settings(max_examples=30, deadline=None)
def test_moving_the_world_by_whole_voxels_changes_nothing(geometry, detections, cells):
    shift = np.array(cells) * COARSE  # whole coarse voxels are whole fine ones, too
    centred = [(np.array(centres(voxels(p, FINE))), e) for p, e in detections]
    config = ObjectConfig(association=AssociationConfig(geometry=geometry, tau=1.3, overlap_voxel_m=COARSE))
    before, _ = through_the_map(centred, config)
    after, _ = through_the_map([(p + shift, e) for p, e in centred], config, shift[2])
    assert before == after


def box(low, high, n=400, seed=0):
    return np.random.default_rng(seed).uniform(low, high, (n, 3))


@pytest.mark.parametrize(("size_prior", "n_objects"), [(True, 2), (False, 1)])
def test_a_thing_is_not_swallowed_by_what_would_make_it_too_large(tools, size_prior, n_objects):
    """A tv on a cupboard up to the ceiling, which includes it: together they'd be no tv, so they stay two, also when
    duplicates are searched for."""
    config = ObjectConfig(
        association=AssociationConfig(w_geometric=2.0, merge_every=1),
        false_positives=FalsePositiveConfig(size_prior=size_prior),
    )
    objects = ObjectMap("0", 0.0, FINE, config)
    things = {"tv": box((0, 0, 0.8), (1.0, 0.3, 1.4), 3000), "cupboard": box((-0.6, 0, 0.4), (1.6, 0.4, 2.5), 30_000)}
    for i, label in enumerate(["tv", "cupboard"]):
        s = located(things[label], tools.unit(0), i, "tv" if label == "tv" else "refrigerator")
        objects.add_located(view(i), (s.detection,), [s])
    labels = sorted(o.label for o in objects.records())
    assert len(labels) == n_objects
    assert n_objects == 1 or labels == ["refrigerator", "tv"]


@pytest.mark.parametrize(("floor_z_m", "status"), [(5.2, "confirmed"), (2.6, "candidate"), (0.0, "candidate")])
def test_heights_are_above_the_floor(tools, floor_z_m, status):
    """A chair on the floor at 5.2 m; as one of the floors below it would hang in the air."""
    objects = ObjectMap("2", floor_z_m, FINE, ObjectConfig())
    points = box((0, 0, 5.2), (0.5, 0.5, 6.1), 2000)
    for i in range(9):
        T = np.eye(4)
        T[0, 3] = i
        s = located(points, tools.unit(0), i)
        s = dataclasses.replace(s, detection=dataclasses.replace(s.detection, chance=0.9))
        objects.add_located(dataclasses.replace(view(i), T_world_camera=T), (s.detection,), [s])
    (chair,) = objects.records()
    assert chair.status == status
    assert status == "confirmed" or chair.reason.startswith("too high for a chair")


def test_embeddings_of_both_sources_count_by_their_detections(tools):
    objects = ObjectMap("0", 0.0, FINE, ObjectConfig())
    points = np.random.default_rng(0).uniform(0, 0.4, (60, 3))
    robot, camera = tools.unit(0), (tools.unit(0) + tools.unit(1)) / np.float32(math.sqrt(2))
    for i in range(5):
        source, look = ("robot/r", robot) if i < 2 else (f"camera/c{i}", camera)
        s = located(points, look)
        objects.add_located(view(i, source), (s.detection,), [s])
    (obj,) = objects._objects.values()
    mean = (2 * robot + 3 * camera) / 5
    np.testing.assert_allclose(
        obj.embedding_sum / np.linalg.norm(obj.embedding_sum), mean / np.linalg.norm(mean), atol=1e-6
    )


@given(
    st.lists(
        st.tuples(st.booleans(), st.sampled_from(["chair", "couch", "bed"]), st.floats(0.3, 1.0)),
        min_size=1,
        max_size=8,
    )
)
@settings(max_examples=60, deadline=None)
def test_confidence_is_the_maximum_of_both_and_the_class_that_of_the_maximum(votes):
    """The paper's confirmation, with the preset's confidence of a class: the mean of its scores."""
    config = FusionConfig.preset("paper").objects
    objects = ObjectMap("0", 0.0, FINE, config)
    points = np.random.default_rng(0).uniform(0, 0.4, (60, 3))
    scores = {True: {}, False: {}}
    for i, (is_robot, label, score) in enumerate(votes):
        s = located(points, [1.0, 0.0], label=label, score=score)
        objects.add_located(view(i, "robot/r" if is_robot else "camera/c"), (s.detection,), [s])
        scores[is_robot].setdefault(label, []).append(score)
    best = {
        is_robot: max(((sum(v) / len(v), label) for label, v in of_kind.items()), default=(0.0, ""))
        for is_robot, of_kind in scores.items()
    }
    confidence, label = max(best.values())
    (record,) = objects.records()
    assert record.confidence == pytest.approx(confidence)
    assert (record.confidence_robot, record.confidence_surveillance) == pytest.approx((best[True][0], best[False][0]))
    ties = [
        c for of_kind in scores.values() for v in of_kind.values() if abs((c := sum(v) / len(v)) - confidence) < 1e-9
    ]
    if len(ties) == 1:
        assert record.label == label


@pytest.mark.parametrize("seed", range(5))
def test_views_of_one_revision_give_the_same_objects_in_whatever_order_they_came(world, tools, seed):
    world.boxes |= {"sofa": ((3.0, 1.2, 0.0), (3.8, 2.8, 0.8)), "stool": ((2.0, 0.4, 0.0), (2.4, 0.8, 0.5))}
    arrived = []
    for i, (x, y, yaw) in enumerate([(0.6, 0.8, 0.3), (0.6, 1.6, 0.0), (0.5, 3.2, -0.4), (1.4, 2.0, 0.0)]):
        for source, height in (("robot/r", 0.88), (f"camera/c{i % 2}", 1.8)):
            seen = world.view(x, y, yaw, -0.3, height=height, source=source, view=i if height > 1 else 0, seq=i)
            found = [
                world.detect(seen, "sofa", "bed" if i == 1 else "couch", 0.5 + 0.1 * i, tools.unit(i % 2)),
                world.detect(seen, "stool", "chair", 0.6, tools.unit(2)),
            ]
            arrived.append((seen, tools.seen(*found)))
    shuffled = [arrived[i] for i in np.random.default_rng(seed).permutation(len(arrived))]

    def objects(views):
        said, joint = {id(v): p for v, p in views}, JointMap()
        for v in in_order(v for v, _ in views):
            joint.integrate(v, said[id(v)])
        return joint.objects("0")

    assert objects(shuffled) == objects(arrived)
