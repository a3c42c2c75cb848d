"""The joint maps as bytes: nothing is lost, and nothing but a snapshot is read."""

from __future__ import annotations

import math
from dataclasses import replace

import msgspec
import numpy as np
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.services.fusion.core import FusionConfig, JointMap, MapConfig
from surveilnav.services.fusion.core.snapshot import SnapshotError, dump, freeze, load, pack


@pytest.fixture
def story(tools):
    """A robot and cameras on two floors, with detections, merges and a stair between."""
    world = tools.world(boxes={"sofa": ((3.0, 1.0, 0.0), (4.6, 1.9, 0.8)), "stool": ((1.0, 3.0, 0.0), (1.4, 3.4, 0.6))})
    rng = np.random.default_rng(5)
    views = [world.view(1 + 0.2 * i, 2, 0.7 * i, -0.2, seq=i) for i in range(12)]
    views += [world.view(5.5, 3.5, -2.4 + i, -0.5, height=1.8, source="camera/c", view=i) for i in range(3)]
    views += [world.view(2 + 0.2 * i, 2, 0.5 * i, seq=12 + i, floor="1", floor_z=2.8) for i in range(4)]
    out = []
    for k, view in enumerate(views):
        labels = (("sofa", "couch"), ("stool", "chair" if k % 3 else "toilet"))
        found = [
            world.detect(view, box, label, rng.uniform(0.4, 0.9), tools.unit(i))
            for i, (box, label) in enumerate(labels)
        ]
        image = rng.standard_normal(8).astype(np.float32)
        out.append((replace(view, stamp_ns=10**9 * (k + 1)), tools.seen(*found, image=image / np.linalg.norm(image))))
    return out


def contents_of(joint: JointMap, text) -> dict:
    """Everything that others may ask, as bytes."""
    out = {}
    for floor in joint.floors:
        cloud, lines = joint.layer(floor, "cloud")[1], joint.layer(floor, "provenance")[1]
        order = np.lexsort(cloud.T)  # in no particular order
        out[floor, "cloud"], out[floor, "provenance"] = cloud[order].tobytes(), lines[order].tobytes()
        for name in ("occupancy", "explored", "frontier", "value"):
            grid, array = joint.layer(floor, name, text)
            out[floor, name] = grid, array.tobytes()
        out[floor, "objects"] = msgspec.msgpack.encode(joint.objects(floor))
        out[floor, "revision"] = joint.floor_revision(floor), joint.source_sets(floor)
    return out


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_maps_read_again_go_on_as_if_nothing_had_happened(story, tools, preset):
    config = FusionConfig.preset(preset)
    steady, restarted = JointMap(config), JointMap(config)
    for i, (view, perception) in enumerate(story):
        one, other = steady.accept(view, perception), restarted.accept(view, perception)
        assert one == other
        if i % 4 == 1:
            restarted = load(dump(restarted), config)
        if i == 6:
            steady.layer("0", "value", tools.unit(0))  # kept up to date from here on
    assert contents_of(restarted, tools.unit(0)) == contents_of(steady, tools.unit(0))
    assert dump(restarted) == dump(load(dump(restarted), config))
    assert steady.objects("0")
    assert len(steady.floors) == 2


def test_bytes_are_the_same_for_the_same_maps(story):
    one, other = JointMap(), JointMap()
    for view, perception in story:
        one.accept(view, perception)
        other.accept(view, perception)
    assert dump(one) == dump(other)


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_a_frozen_copy_stays_as_it_was(story, preset):
    joint = JointMap(FusionConfig.preset(preset))
    for view, perception in story[:9]:
        joint.accept(view, perception)
    frozen = freeze(joint)
    then = pack(frozen)
    for view, perception in story[9:]:
        joint.accept(view, perception)
    assert pack(frozen) == then != dump(joint)


def test_damaged_bytes_are_refused_by_name(story):
    joint = JointMap()
    for view, perception in story[:2]:
        joint.accept(view, perception)
    data, config = dump(joint), FusionConfig()

    @settings(max_examples=60)
    @given(st.integers(0, len(data) - 1), st.integers(1, 255), st.sampled_from(["flipped", "cut"]))
    def check(at, bits, how):
        bad = data[:at] if how == "cut" else data[:at] + bytes([data[at] ^ bits]) + data[at + 1 :]
        try:
            assert dump(load(bad, config)) == data  # a bit of zstd's that means nothing
        except SnapshotError as error:
            assert error.name == "corrupt"  # noqa: PT017

    check()


def test_what_is_no_snapshot_of_these_maps_is_refused_by_name():
    data, config = dump(JointMap()), FusionConfig()
    state = msgspec.msgpack.decode(zstandard.decompress(data))
    for change, name in (
        ({"version": 99}, "other_version"),
        ({"sizes": {"resolution_m": 0.1}}, "other_config"),
        ({"maps": {}}, "corrupt"),
        ({"maps": {**state["maps"], "floors": [1]}}, "corrupt"),
    ):
        with pytest.raises(SnapshotError) as refused:
            load(zstandard.compress(msgspec.msgpack.encode(state | change)), config)
        assert refused.value.name == name
    with pytest.raises(SnapshotError) as refused:
        load(data, FusionConfig(map=MapConfig(voxel_m=0.05)))
    assert refused.value.name == "other_config"
    assert load(data, config).floors == {}
    assert math.isclose(load(data, FusionConfig(map=MapConfig(tau_z_m=0.2))).config.map.tau_z_m, 0.2)  # may change
