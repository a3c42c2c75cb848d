"""Embeddings of two models are never compared; a view is looked at again for new words, without its picture being new."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.objects.association import similarity
from surveilnav.services.fusion.core.objects.config import AssociationConfig
from surveilnav.services.fusion.core.objects.shape import Shape
from surveilnav.services.fusion.core.snapshot import dump, load

STOOL = ((2.0, 1.5, 0.0), (2.6, 2.1, 0.9))


def perception_of(tools, view, world, label="stool", axis=0, model="clip", words=("stool",), image=True):
    """What a detector says of the stool in a view."""
    found = world.detect(view, "stool", label, 0.8, tools.unit(axis))
    seen = tools.seen(found, image=tools.unit(7) if image else np.zeros(0, np.float32))
    return replace(seen, embedding_model=model, words=words)


@pytest.fixture
def stool(world):
    world.boxes["stool"] = STOOL
    return world


def near(world, seq=1, stamp_s=1, source="camera/c"):
    view = world.view(0.6, 1.8, 0.0, -0.3, height=1.8, source=source, seq=seq)
    return replace(view, stamp_ns=stamp_s * 10**9)


def test_a_value_layer_holds_only_its_own_models_views(stool, tools):
    joint = JointMap()
    for seq, model in ((1, "clip"), (2, "siglip")):
        view = near(stool, seq, seq, "robot/r")
        joint.accept(view, perception_of(tools, view, stool, model=model))
    for model in ("clip", "siglip"):
        _, value = joint.layer("0", "value", tools.unit(7), model)
        assert np.nanmax(value) == pytest.approx(1.0, abs=1e-3)
        assert joint.views_left_out("0", model) == 1
    assert np.isnan(joint.layer("0", "value", tools.unit(7), "another")[1]).all()
    assert joint.views_left_out("0", "another") == 2


def test_an_object_seen_by_two_models_is_one_by_its_place_and_has_the_newest_embedding(stool, tools):
    joint = JointMap()
    for seq, model, axis in ((1, "clip", 0), (2, "clip", 0), (3, "siglip", 1)):
        view = near(stool, seq, seq, "robot/r")
        joint.accept(view, perception_of(tools, view, stool, axis=axis, model=model))
    (one,) = joint.objects("0")
    assert one.n_detections == 3
    assert joint.relevances("0", tools.unit(1), "siglip") == {one.id: pytest.approx(1.0)}
    assert joint.relevances("0", tools.unit(0), "clip") == {one.id: None}


@pytest.mark.parametrize("comparable", [True, False])
def test_without_looks_to_compare_geometry_has_all_the_weight(comparable, tools):
    points = np.random.default_rng(0).uniform(0, 0.5, (400, 3))
    c = AssociationConfig()
    shape = Shape.from_points(points, 0.05, c.overlap_voxel_m)
    found = similarity(shape, tools.unit(0), shape, tools.unit(1), c, comparable=comparable)
    assert found.s == pytest.approx(c.w_geometric if comparable else c.w_geometric + c.w_visual)


def test_a_view_looked_at_again_gives_its_new_words_and_nothing_twice(stool, tools):
    joint, view = JointMap(), near(stool)
    both = perception_of(tools, view, stool, words=("samovar", "stool"))
    samovar = replace(both.detections[0], label="samovar")
    joint.accept(view, perception_of(tools, view, stool))
    before = joint.objects("0")[0]
    done = joint.accept(view, replace(both, detections=(both.detections[0], samovar)))
    assert done is not None
    assert (done.n_points, done.n_located) == (0, 1)
    after = joint.objects("0")
    assert sum(o.n_detections for o in after) == before.n_detections + 1
    assert {e.label for o in after for e in o.history} == {"stool", "samovar"}
    assert joint.accept(view, both) is None, "those words were looked for"
    lamp = replace(both, words=("lamp",), detections=())
    assert joint.accept(view, lamp) is not None
    assert joint.accept(view, both) is None, "and still are, whatever came between"


def test_a_cameras_view_gets_the_embedding_of_the_model_that_runs_now(stool, tools):
    joint, view = JointMap(), near(stool)
    first = perception_of(tools, view, stool)
    joint.accept(view, first)
    seen = joint.objects("0")[0].n_detections
    assert joint.accept(view, replace(first, embedding_model="siglip", image_embedding=tools.unit(6))) is not None
    assert joint.views_left_out("0", "siglip") == 0
    assert np.nanmax(joint.layer("0", "value", tools.unit(6), "siglip")[1]) == pytest.approx(1.0, abs=1e-3)
    assert joint.objects("0")[0].n_detections == seen, "one picture is no evidence twice"
    robots = near(stool, source="robot/r")
    joint.accept(robots, first)
    assert joint.accept(robots, replace(first, embedding_model="siglip")) is None


def test_a_detector_with_a_vocabulary_adds_what_the_last_one_did_not_look_for(stool, tools):
    """A change from an open vocabulary to a closed set: the same picture, all names of the set."""
    joint, view = JointMap(), near(stool)
    joint.accept(view, replace(perception_of(tools, view, stool, words=("lamp",)), detections=()))
    assert joint.objects("0") == []
    closed = perception_of(tools, view, stool, model="class-space", words=("chair", "lamp", "stool"))
    assert joint.accept(view, closed) is not None
    (one,) = joint.objects("0")
    assert (one.label, one.n_detections) == ("stool", 1)
    assert joint.accept(view, closed) is None


def test_a_robots_view_is_not_looked_at_again(stool, tools):
    joint, view = JointMap(), near(stool, source="robot/r")
    joint.accept(view, perception_of(tools, view, stool))
    assert joint.accept(view, perception_of(tools, view, stool, words=("samovar",))) is None


def test_models_and_words_survive_a_restart(stool, tools):
    joint, view = JointMap(), near(stool)
    joint.accept(view, perception_of(tools, view, stool))
    again = load(dump(joint), FusionConfig())
    assert again.relevances("0", tools.unit(0), "clip") == {1: pytest.approx(1.0)}
    assert again.views_left_out("0", "clip") == 0
    assert again.accept(view, perception_of(tools, view, stool)) is None
    assert again.accept(view, perception_of(tools, view, stool, words=("stool", "lamp"))) is not None
