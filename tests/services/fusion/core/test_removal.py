"""Taking a source out of the joint maps by provenance: what only it has seen is gone, what others have seen stays."""

from __future__ import annotations

import numpy as np
import pytest

from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.removal import Contribution, without
from surveilnav.services.fusion.core.snapshot import dump, load

SOFA, TABLE = ((3.0, 1.0, 0.0), (4.6, 1.9, 0.8)), ((14.0, 1.0, 0.0), (15.0, 2.0, 0.8))


class Maps:
    """A joint map in a long room: the robot at its west end, camera a at its east end, camera b beside the robot."""

    def __init__(self, tools) -> None:
        self.tools = tools
        self.world = tools.world(room=((0.0, 0.0, 0.0), (18.0, 4.0, 2.5)), boxes={"sofa": SOFA, "table": TABLE})
        self.joint = JointMap(FusionConfig())

    def see(self, source: str, seq: int, x: float, yaw: float, **more) -> None:
        kind = {"height": 1.8} if source.startswith("camera/") else {}
        view = self.world.view(x, 2.0, yaw, -0.5, source=source, seq=seq, range_m=(0.1, 4.0), **kind, **more)
        found = [
            self.world.detect(view, "sofa", "couch", 0.8, self.tools.unit(0)),
            self.world.detect(view, "table", "table", 0.8, self.tools.unit(1)),
        ]
        self.joint.integrate(view, self.tools.seen(*found, image=self.tools.unit(seq % 4)))

    def robot(self) -> Maps:
        for seq in range(1, 4):
            self.see("robot/r", seq, 1.0, -0.3 + 0.2 * seq)
        return self

    def camera_a(self) -> Maps:
        for seq in range(11, 14):
            self.see("camera/a", seq, 17.0, np.pi - 0.3 + 0.2 * seq % 0.6)
        return self

    def camera_b(self) -> Maps:
        for seq in range(21, 24):
            self.see("camera/b", seq, 1.5, -0.3 + 0.02 * seq)
        return self


@pytest.fixture
def maps(tools):
    return lambda: Maps(tools)


def layer(joint: JointMap, name: str, shape_of: JointMap) -> np.ndarray:
    """A layer on the grid of another map, which contains its own."""
    (grid, array), (large, _) = joint.layer("0", name), shape_of.layer("0", name)
    out = np.zeros(large.shape, array.dtype)
    row, col = (
        round((a - b) / grid.resolution_m)
        for a, b in ((grid.origin_y_m, large.origin_y_m), (grid.origin_x_m, large.origin_x_m))
    )
    out[row : row + grid.rows, col : col + grid.cols] = array
    return out


def voxels(joint: JointMap) -> dict[bytes, tuple[str, ...]]:
    """Who has seen each voxel, by its mean position and colour."""
    sets, lines = joint.source_sets("0"), joint.layer("0", "provenance")[1]
    cloud = joint.layer("0", "cloud")[1]
    return {point.tobytes(): tuple(sets[number]) for point, number in zip(cloud, lines[:, 0], strict=True)}


def test_where_others_never_look_the_maps_are_as_if_it_had_never_been_there(maps):
    both, clean = maps().robot().camera_a().joint, maps().robot().joint
    removed = without(both, Contribution("camera/a"))
    assert voxels(removed) == voxels(clean)
    assert {o.id for o in removed.objects("0")} == {o.id for o in clean.objects("0")}
    assert [o.label for o in removed.objects("0")] == ["couch"] != [o.label for o in both.objects("0")]
    for name in ("occupancy", "explored"):
        assert layer(both, name, both).sum() > layer(clean, name, both).sum()
    assert (layer(removed, "occupancy", both) == layer(clean, "occupancy", both)).all()
    # floor over which only rays pass can't be told from floor that others see
    more = layer(removed, "explored", both).sum() - layer(clean, "explored", both).sum()
    assert 0 <= more < 0.2 * (layer(both, "explored", both).sum() - layer(clean, "explored", both).sum())
    text = np.ones(8, np.float32)
    assert np.nansum(removed.layer("0", "value", text)[1]) == pytest.approx(
        np.nansum(clean.layer("0", "value", text)[1])
    )


def test_what_others_have_seen_too_stays_without_its_name(maps):
    both = maps().robot().camera_b().joint
    removed = without(both, Contribution("camera/b"))
    before, after = voxels(both), voxels(removed)
    assert after == {
        key: tuple(s for s in sources if s != "camera/b") for key, sources in before.items() if sources != ("camera/b",)
    }
    assert {len(s) for s in before.values()} == {1, 2}
    (couch,) = removed.objects("0")
    assert couch.sources == ["robot/r"]
    assert couch.confidence_surveillance == 0.0
    assert {e.source for e in couch.history} == {"robot/r"}
    assert (removed.revision, removed.floor_revision("0")) == (both.revision + 1,) * 2


def test_a_floor_that_nobody_else_has_seen_is_gone(maps):
    made = maps().robot()
    made.world.room = ((0.0, 0.0, 0.0), (18.0, 4.0, 2.5))
    made.see("camera/up", 1, 1.0, 0.0, floor="1", floor_z=4.0)
    assert set(made.joint.floors) == {"0", "1"}
    removed = without(made.joint, Contribution("camera/up"))
    assert set(removed.floors) == {"0"}
    assert without(removed, Contribution("robot/r")).floors == {}
    with pytest.raises(KeyError, match="nothing was seen yet of floor '1'"):
        removed.objects("1")


@pytest.mark.parametrize(
    ("since", "until", "is_gone"), [(11, 13, True), (None, 13, True), (12, None, False), (14, 20, False)]
)
def test_of_a_time_span_only_what_was_never_seen_outside_it_is_gone(maps, since, until, is_gone):
    both = maps().robot().camera_a().joint
    removed = without(both, Contribution("camera/a", since, until))
    assert ("table" not in [o.label for o in removed.objects("0")]) == is_gone
    assert (("camera/a",) not in voxels(removed).values()) == is_gone
    if since == 14:
        assert voxels(removed) == voxels(both)


def test_they_go_on_and_last(maps):
    made = maps().robot().camera_a().camera_b()
    made.joint = without(made.joint, Contribution("camera/a"))
    assert dump(load(dump(made.joint), made.joint.config)) == dump(made.joint)
    made.camera_a()
    assert ("camera/a",) in voxels(made.joint).values()
    assert sorted(o.label for o in made.joint.objects("0")) == ["couch", "table"]
    before = voxels(made.joint)
    assert voxels(without(made.joint, Contribution("camera/nobody"))) == before
