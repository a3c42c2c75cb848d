"""The joint value map (eq. 2) and its variants."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.geometry import Grid, Pinhole, camera_pose
from surveilnav.sensing.views import PosedView
from surveilnav.services.fusion.core import FusionConfig, JointMap, ValueConfig
from surveilnav.services.fusion.core.maps.projection import azimuth_bins, azimuth_ranges, world_points
from surveilnav.services.fusion.core.maps.value import ValueMap


@pytest.fixture
def story(world, tools):
    """Views of a robot and two cameras with image embeddings that sound more or less like the target e0."""

    def picture(score):
        return np.array([score, math.sqrt(1 - score**2), 0, 0, 0, 0, 0, 0], np.float32)

    rng = np.random.default_rng(2)
    out = [(world.view(1 + 0.3 * i, 2, 0.5 * i, seq=i), picture(rng.uniform(0, 0.9))) for i in range(6)]
    for name, x, yaw in (("a", 0.5, 0.4), ("b", 5.5, 2.6)):
        for k in range(3):
            view = world.view(x, 0.5, yaw + 0.5 * k, -0.5, height=1.8, source=f"camera/{name}", view=k)
            out.append((view, picture(rng.uniform(0, 0.9))))
    return out


def joint_of(story, tools, fusion):
    joint = JointMap(FusionConfig(value=ValueConfig(fusion=fusion)))
    for view, image in story:
        joint.integrate(view, tools.seen(image=image))
    return joint


def footprint(view, grid):
    """(azimuth bin or -1) of every cell of the grid that the view covers; its geometry is tested elsewhere."""
    c = FusionConfig().map
    limit = c.max_range_robot_m if view.is_robot else c.max_range_camera_m
    points, _ = world_points(view, c.points_per_view, limit, c.depth_edge)
    ranges_m = (
        azimuth_ranges(points, view.T_world_camera[:3, 3], c.explored_max_m).astype(np.float16).astype(np.float32)
    )
    row0, col0 = round(grid.origin_y_m / grid.resolution_m), round(grid.origin_x_m / grid.resolution_m)
    x, y, _ = view.T_world_camera[:3, 3]
    return azimuth_bins(ranges_m, x, y, grid.resolution_m, row0, col0, grid.rows, grid.cols)


def test_average_is_equation_2(story, tools):
    joint = joint_of(story, tools, "average")
    grid, found = joint.layer("0", "value", tools.unit(0))
    sums, counts = np.zeros((2, *grid.shape)), np.zeros((2, *grid.shape))
    for view, image in story:
        covered = footprint(view, grid) >= 0
        sums[int(not view.is_robot)][covered] += np.float16(image[0])
        counts[int(not view.is_robot)][covered] += 1
    expected = np.full(grid.shape, np.nan)
    both = 0
    for r, c in np.argwhere(counts.sum(axis=0) > 0):
        averages = [sums[k, r, c] / counts[k, r, c] for k in (0, 1) if counts[k, r, c]]
        expected[r, c] = (averages[0] + averages[1]) / 2 if len(averages) == 2 else averages[0]
        both += len(averages) == 2
    assert both > 100
    np.testing.assert_allclose(found, expected, atol=1e-4)


def test_confidence_is_vlfms_rule(story, tools):
    joint = joint_of(story, tools, "confidence")
    grid, found = joint.layer("0", "value", tools.unit(0))
    value, weight = np.full(grid.shape, np.nan), np.zeros(grid.shape)
    for view, image in story:
        azimuths = footprint(view, grid)
        forward = view.T_world_camera[:3, 2]
        axis, half_fov = math.atan2(forward[1], forward[0]), math.radians(79) / 2
        for r, c in np.argwhere(azimuths >= 0):
            angle = abs(math.remainder(math.radians(azimuths[r, c] + 0.5) - axis, math.tau))
            w = 0.25 + 0.75 * math.cos(min(1.0, angle / half_fov) * math.pi / 2) ** 2
            v, c0, score = value[r, c], weight[r, c], float(np.float16(image[0]))
            value[r, c] = score if c0 == 0 else (c0 * v + w * score) / (c0 + w)
            weight[r, c] = (c0**2 + w**2) / (c0 + w)
    np.testing.assert_allclose(found, value, atol=1e-3)


def test_latest_is_the_last_word(story, tools):
    joint = joint_of(story, tools, "latest")
    grid, found = joint.layer("0", "value", tools.unit(0))
    view, image = story[-1]
    assert np.allclose(found[footprint(view, grid) >= 0], np.float16(image[0]))


def test_a_second_target_gets_its_map_from_what_was_seen_before(story, tools):
    early, late = JointMap(), JointMap()
    early.integrate(story[0][0], tools.seen(image=story[0][1]))
    early.layer("0", "value", tools.unit(1))  # asked for from the start ...
    for view, image in story:
        early.integrate(view, tools.seen(image=image))
        late.integrate(view, tools.seen(image=image))
    fresh, kept = (j.layer("0", "value", tools.unit(1))[1] for j in (late, early))  # ... or only now
    np.testing.assert_allclose(fresh, kept, atol=1e-6)
    assert np.isfinite(fresh).sum() > 1000
    assert not np.allclose(fresh, late.layer("0", "value", tools.unit(0))[1], equal_nan=True)


def test_a_cameras_new_picture_takes_the_place_of_its_old_one(story, tools):
    view, _ = story[-1]
    joint = JointMap()
    for i in (0, 1, 2):
        joint.integrate(view, tools.seen(image=tools.unit(i)))
        joint.layer("0", "value", tools.unit(2))
    found = joint.layer("0", "value", tools.unit(2))[1]
    np.testing.assert_allclose(found[np.isfinite(found)], 1.0)


def test_another_backends_embeddings_say_nothing(story, tools):
    joint = joint_of(story, tools, "confidence")
    assert np.isnan(joint.layer("0", "value", np.ones(5, np.float32))[1]).all()


def test_robot_views_are_forgotten_beyond_the_limit(world, tools):
    joint = JointMap(FusionConfig(value=ValueConfig(max_views=3)))
    joint.integrate(world.view(1, 1, 0, source="camera/c"), tools.seen(image=tools.unit(0)))
    for i in range(5):
        joint.integrate(world.view(3, 2, i, seq=i), tools.seen(image=tools.unit(0)))
    assert len(joint._floors["0"].value) == 3
    grid, found = joint.layer("0", "value", tools.unit(0))
    row, col = grid.cells_of((4.0, 1.0))
    assert np.isfinite(found[row, col])  # the camera's view is kept


# --- against a literal reference, with and without decay ------------------------------------------------------------

GRID = Grid(-1.5, -1.5, 0.15, 20, 20)
HALF_LIFE_S = 15.0  # of views up to 20 minutes old
EYE = Pinhole.from_hfov(16, 12, math.radians(79))


@dataclass(frozen=True)
class Look:
    """A view for the reference: where from, how far it reaches in which sector, what it sounds like, when."""

    camera: bool
    k: int  # of the camera's view
    x: float
    y: float
    yaw_deg: int
    range_m: float
    score: float
    stamp_s: int

    def view(self, seq: int) -> PosedView:
        T = camera_pose((self.x, self.y, 1.0), math.radians(self.yaw_deg), -0.2)
        source, view = ("camera/c", self.k) if self.camera else ("robot/r", 0)
        rgb, depth_m = np.zeros((12, 16, 3), np.uint8), np.zeros((12, 16), np.float32)
        return PosedView(source, view, seq, self.stamp_s * 10**9, "0", T, EYE, 1.0, rgb, depth_m, (0.1, 5.0))

    @cached_property
    def ranges_m(self) -> np.ndarray:
        out = np.zeros((360, 2), np.float32)
        for a in range(self.yaw_deg - 39, self.yaw_deg + 39):
            out[a % 360] = 0.1, self.range_m
        return out

    @cached_property
    def kept_ranges_m(self) -> list[list[float]]:
        return self.ranges_m.astype(np.float16).tolist()

    @property
    def embedding(self) -> np.ndarray:
        return np.array([self.score, math.sqrt(1 - self.score**2)], np.float32)

    def bin_at(self, x: float, y: float) -> int:
        """The azimuth bin under which it sees a place; -1: it doesn't."""
        dx, dy = x - self.x, y - self.y
        a = int((math.atan2(dy, dx) / (2 * math.pi) + 1.0) * 360) % 360
        near, far = self.kept_ranges_m[a]
        return a if far > 0 and near <= math.sqrt(dx * dx + dy * dy) <= far else -1


looks = st.lists(
    st.builds(
        Look,
        st.booleans(),
        st.integers(0, 2),
        st.floats(-1, 1),
        st.floats(-1, 1),
        st.integers(0, 359),
        st.floats(0.3, 1.5),
        st.floats(0, 0.95),
        st.one_of(st.just(0), st.integers(1, 1200)),
    ),
    min_size=1,
    max_size=10,
)


def literal(story: list[Look], fusion: str, half_life_s: float) -> np.ndarray:
    """Eq. 2 and its variants, cell by cell and view by view."""
    kept: dict[object, tuple[Look, float]] = {}
    newest = 0.0
    for i, look in enumerate(story):
        newest = max(newest, look.stamp_s)
        key = look.k if look.camera else ("robot", i)
        kept.pop(key, None)  # a camera's view takes the place of its former self
        kept[key] = look, look.stamp_s or newest
    first = next((at_s for _, at_s in kept.values() if at_s), 0)
    out = np.full(GRID.shape, np.nan)
    for row in range(GRID.rows):
        for col in range(GRID.cols):
            x = (round(GRID.origin_x_m / 0.15) + col + 0.5) * 0.15
            y = (round(GRID.origin_y_m / 0.15) + row + 0.5) * 0.15
            seen = []
            for look, at_s in kept.values():
                a = look.bin_at(x, y)
                if a >= 0:
                    w = 0.5 ** ((newest - (at_s or first)) / half_life_s) if half_life_s else 1.0
                    off = abs(math.remainder(math.radians(a + 0.5 - look.yaw_deg), math.tau)) / math.radians(39.5)
                    cone = 0.25 + 0.75 * math.cos(min(1.0, off) * math.pi / 2) ** 2
                    seen.append((look.camera, float(np.float16(look.score)), w, cone))
            if not seen:
                continue
            if fusion == "latest":
                out[row, col] = seen[-1][1]
            elif fusion == "confidence":  # VLFM
                v = c = 0.0
                for _, s, w, cone in seen:
                    v, c = (c * v + w * cone * s) / (c + w * cone), (c**2 + (w * cone) ** 2) / (c + w * cone)
                out[row, col] = v
            else:  # eq. 2
                means, fresh = [], []
                for kind in (False, True):
                    of_kind = [(s, w) for camera, s, w, _ in seen if camera == kind]
                    if of_kind:
                        means.append(sum(s * w for s, w in of_kind) / sum(w for _, w in of_kind))
                        fresh.append(max(w for _, w in of_kind))
                out[row, col] = sum(m * f for m, f in zip(means, fresh, strict=True)) / sum(fresh)
    return out


def value_map(story, fusion, half_life_s, *, ask_at=(), **more):
    value = ValueMap(ValueConfig(fusion=fusion, half_life_s=half_life_s, **more))
    for i, look in enumerate(story):
        value.add(look.view(i), look.embedding, ranges_m=look.ranges_m)
        if i in ask_at:
            value.layer(GRID, np.array([1.0, 0.0], np.float32))
    return value


@pytest.mark.parametrize("half_life_s", [0.0, HALF_LIFE_S])
@pytest.mark.parametrize("fusion", ["average", "confidence", "latest"])
def test_layers_equal_the_literal_rules(fusion, half_life_s):
    @settings(max_examples=12)
    @given(looks, st.integers(0, 9))
    def check(story, ask_at):
        value = value_map(story, fusion, half_life_s, ask_at={ask_at})  # incremental from some view on
        found = value.layer(GRID, np.array([1.0, 0.0], np.float32))
        np.testing.assert_allclose(found, literal(story, fusion, half_life_s), atol=2e-3)

    check()


@pytest.mark.parametrize("fusion", ["average", "confidence", "latest"])
def test_a_layer_made_now_is_bit_by_bit_the_one_kept_from_the_start(fusion):
    @settings(max_examples=12)
    @given(st.lists(looks, min_size=3, max_size=3).map(lambda lists: [look for some in lists for look in some]))
    def check(story):
        text = np.array([1.0, 0.0], np.float32)
        kept = value_map(story, fusion, 1.0, ask_at=range(99), max_views=8)  # 1 s: rescaled often; 8: some forgotten
        fresh = value_map(story, fusion, 1.0, max_views=8)
        assert kept.layer(GRID, text).tobytes() == fresh.layer(GRID, text).tobytes()

    check()


def test_a_layer_built_beside_the_map_is_the_same(story, tools):
    joint, other = JointMap(), JointMap()
    for i, (view, image) in enumerate(story):
        joint.integrate(view, tools.seen(image=image))
        other.integrate(view, tools.seen(image=image))
        if i == 4:
            pending = joint.pending_value("0", tools.unit(0))
    joint.adopt_value("0", pending.build())  # it took until seven more views had come
    assert joint.pending_value("0", tools.unit(0)) is None
    assert (
        joint.layer("0", "value", tools.unit(0))[1].tobytes() == other.layer("0", "value", tools.unit(0))[1].tobytes()
    )
    stale = joint.pending_value("0", tools.unit(1))
    joint.integrate(replace(story[-1][0], seq=9), tools.seen(image=tools.unit(1)))  # a camera's view goes
    joint.adopt_value("0", stale.build())
    assert joint.pending_value("0", tools.unit(1)) is not None


def test_equal_or_missing_stamps_mean_no_decay(story, tools):
    layers = []
    for half_life_s, stamp in ((0.0, 5), (1e-6, 5), (1e-6, 0)):
        joint = JointMap(FusionConfig(value=ValueConfig(half_life_s=half_life_s)))
        for view, image in story:
            joint.integrate(replace(view, stamp_ns=stamp * 10**9), tools.seen(image=image))
        layers.append(joint.layer("0", "value", tools.unit(0))[1].tobytes())
    assert layers[0] == layers[1] == layers[2]


@pytest.mark.parametrize("fusion", ["average", "confidence"])
def test_what_was_seen_an_eternity_ago_still_was_seen(fusion):
    def look(x, score, stamp_s):
        return Look(False, 0, x, 0.02, 0, 1.0, score, stamp_s)

    story = [look(-0.9, 0.5, 10), look(-0.4, 0.9, 10 + 10**6), look(-0.4, 0.3, 20)]
    found = value_map(story, fusion, 1.0, ask_at={0}).layer(GRID, np.array([1.0, 0.0], np.float32))
    for x, expected in ((-0.6, 0.5), (-0.1, 0.9), (0.3, 0.9)):  # the old one alone; all three; two
        row, col = GRID.cells_of((x, 0.02))
        assert found[row, col] == pytest.approx(expected, abs=1e-3)


def test_an_old_look_counts_half_after_a_half_life():
    old, new = (Look(False, 0, -0.8, 0.02, 0, 1.5, score, at) for score, at in ((0.9, 100), (0.3, 115)))
    row, col = GRID.cells_of((0.0, 0.02))
    found = value_map([old, new], "average", HALF_LIFE_S).layer(GRID, np.array([1.0, 0.0], np.float32))
    assert found[row, col] == pytest.approx((0.5 * 0.9 + 0.3) / 1.5, abs=1e-3)
    by_camera = replace(new, camera=True)  # eq. 2 weighs the two sides by their last looks
    found = value_map([old, by_camera], "average", HALF_LIFE_S).layer(GRID, np.array([1.0, 0.0], np.float32))
    assert found[row, col] == pytest.approx((0.5 * 0.9 + 0.3) / 1.5, abs=1e-3)
    assert FusionConfig.preset("paper").value.half_life_s == 0


def test_the_layer_of_another_place_is_empty(story, tools):
    value = value_map([Look(False, 0, 0, 0, 0, 1.0, 0.5, 0)], "average", 0.0)
    for origin in ((20.0, 20.0), (-30.0, -30.0), (20.0, -30.0)):
        assert np.isnan(value.layer(Grid(*origin, 0.1, 30, 40), np.array([1.0, 0.0], np.float32))).all()
