"""A map from before: it counts until something else is seen, and nothing of it counts as seen."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest

from surveilnav.errors import ConfigError
from surveilnav.occupancy import OBSTACLE, PRIOR_FREE, PRIOR_OBSTACLE
from surveilnav.robot_frame import Nav2Map, PlanarTransform
from surveilnav.robot_frame.nav2_map import FREE, OCCUPIED
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.core.maps.prior import PriorMap
from surveilnav.services.fusion.core.removal import Contribution, without
from surveilnav.services.fusion.core.snapshot import digest, dump, freeze, load
from surveilnav.services.fusion.core.views.validation import ViewError

#: The room of ``tests.world.World``, 6 x 4 m, and a wing of 4 m beside it that nobody sees; a wall that isn't there any more.
GONE = (1.9, 2.1, 1.0, 3.0)


def nav2_map(cell_m=0.05):
    cells = np.full((round(4.2 / cell_m), round(10.2 / cell_m)), OCCUPIED, np.uint8)
    x, y = np.meshgrid(
        *((np.arange(n) + 0.5) * cell_m - 0.1 for n in cells.shape[::-1]), indexing="xy"
    )  # its origin lies 0.1 m before the room's corner
    cells[(x > 0) & (x < 6) & (y > 0) & (y < 4)] = FREE
    cells[(x > 6.1) & (x < 10) & (y > 0) & (y < 4)] = FREE
    cells[(x > GONE[0]) & (x < GONE[1]) & (y > GONE[2]) & (y < GONE[3])] = OCCUPIED
    return Nav2Map(cells, cell_m, PlanarTransform(-0.1, -0.1))


def with_prior(prior=None, floor="0"):
    config = FusionConfig()
    prior = prior or PriorMap(nav2_map(), PlanarTransform())
    return config.model_copy(update={"map": config.map.with_priors({floor: prior})})


def at(joint, name, x, y):
    grid, array = joint.layer("0", name)
    row, col = grid.cells_of((x, y))
    return int(array[row, col])


@pytest.fixture
def looked(world):
    """Maps of a robot that has looked around in the room."""
    joint = JointMap(with_prior())
    integrate(joint, world)
    return joint


def integrate(joint, world):
    for k in range(12):
        with suppress(ViewError):
            joint.accept(replace(world.view(1.0, 2.0, k * math.tau / 12, -0.5, seq=k + 1), stamp_ns=k), None)


def test_what_nobody_has_seen_is_known_but_not_explored(looked):
    assert at(looked, "occupancy", 8.0, 2.0) == PRIOR_FREE
    assert at(looked, "occupancy", 10.05, 2.0) == PRIOR_OBSTACLE
    assert at(looked, "explored", 8.0, 2.0) == 0
    assert at(looked, "occupancy", 12.0, 2.0) == 0, "beyond the map nothing is known"


def test_what_is_seen_overrules_it(looked):
    assert at(looked, "occupancy", 2.0, 2.0) == 0, "the wall that is gone: its floor was seen"
    assert at(looked, "explored", 1.5, 2.0) == 1
    assert at(looked, "occupancy", 1.5, 2.0) == 0
    occupancy = looked.layer("0", "occupancy")[1]
    assert (occupancy == OBSTACLE).any()
    explored = looked.layer("0", "explored")[1] != 0
    assert not (explored & (occupancy == PRIOR_FREE)).any()


def test_frontiers_lie_where_seen_floor_borders_on_known_but_unseen(world):
    joint, alone = JointMap(with_prior()), JointMap()
    for k, maps in enumerate((joint, alone)):
        maps.accept(replace(world.view(1.0, 2.0, 0.0, -0.6, range_m=(0.1, 2.5)), stamp_ns=k), None)
    frontier = joint.layer("0", "frontier")[1]
    rows, cols = np.nonzero(frontier)
    assert len(rows)
    occupancy = joint.layer("0", "occupancy")[1]
    beside = np.array(
        [(occupancy[r - 1 : r + 2, c - 1 : c + 2] == PRIOR_FREE).any() for r, c in zip(rows, cols, strict=True)]
    )
    assert beside.mean() > 0.9
    assert frontier.sum() <= alone.layer("0", "frontier")[1].sum(), "known walls are no frontier"


def test_it_outlasts_snapshots_removals_and_restarts_and_comes_with_the_building_file(looked, world):
    again = load(dump(looked), looked.config)
    assert np.array_equal(again.layer("0", "occupancy")[1], looked.layer("0", "occupancy")[1])
    assert at(without(looked, Contribution("camera/none")), "occupancy", 8.0, 2.0) == PRIOR_FREE
    plain = JointMap()
    integrate(plain, world)
    assert at(load(dump(plain), with_prior()), "occupancy", 8.0, 2.0) == PRIOR_FREE
    assert at(load(dump(looked), FusionConfig()), "occupancy", 8.0, 2.0) == 0


def test_other_floors_know_nothing(world):
    joint = JointMap(with_prior(floor="1"))
    integrate(joint, world)
    occupancy = joint.layer("0", "occupancy")[1]
    assert not np.isin(occupancy, (PRIOR_FREE, PRIOR_OBSTACLE)).any()


def test_one_that_lies_too_far_away_is_left_out(world):
    joint = JointMap(with_prior(PriorMap(nav2_map(), PlanarTransform(500.0, 0.0))))
    integrate(joint, world)
    assert at(joint, "explored", 1.5, 2.0) == 1


MAP_YAML = "image: ground.pgm\nresolution: {resolution}\norigin: [-1.0, -2.0, 0.0]\n"
BUILDING = """\
building: shed
floors:
  ground:
    nav2_map: ground.yaml
    T_building_map: {x_m: 3.0, y_m: 1.0, yaw_deg: 90}
"""


def written(tmp_path, resolution=0.1, building=BUILDING):
    (tmp_path / "ground.pgm").write_bytes(b"P5 20 10 255\n" + bytes([254] * 200))
    (tmp_path / "ground.yaml").write_text(MAP_YAML.format(resolution=resolution))
    file = tmp_path / "building.yaml"
    file.write_text(building)
    return str(file)


def test_the_building_file_names_it(tmp_path):
    config = FusionSettings(building_file=written(tmp_path), map={"extent_m": 10.0}).core()
    prior = config.map.prior_of("ground")
    assert prior is not None
    assert prior.extent() == pytest.approx((4.0, 0.0, 5.0, 2.0))  # turned by a quarter: x is y
    assert config.map.prior_of("0") is None
    assert FusionSettings().core().map.prior_of("ground") is None


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"building": BUILDING.replace("ground.yaml", "none.yaml")}, "none.yaml"),
        ({"resolution": 0.99, "building": BUILDING}, ""),
        ({"building": BUILDING.replace("x_m: 3.0, ", "")}, "line 5"),
    ],
)
def test_mistakes_are_named(tmp_path, change, named):
    settings = FusionSettings(building_file=written(tmp_path, **change), map={"max_extent_m": 15.0})
    with pytest.raises(ConfigError, match=named or "at most 15 m"):
        settings.core()


def test_from_a_recordings_settings_the_same_maps_come(world):
    """A recording holds the settings as text, and with them what was known before."""
    prior = PriorMap(nav2_map(), PlanarTransform(15.0, -0.03, 0.1))  # so far that the maps grow
    written_config = with_prior(prior).model_dump_json()
    again = FusionConfig.model_validate_json(written_config)
    assert again.model_dump_json() == written_config
    digests = []
    for config in (with_prior(prior), again, FusionConfig()):
        joint = JointMap(config)
        integrate(joint, world)
        digests.append(digest(freeze(joint)))
    assert digests[0] == digests[1] != digests[2]
    assert "priors" not in FusionConfig().model_dump_json()


@pytest.mark.parametrize("text", ["", "?", "AAAA", 5, None, "KLUv/QBYEQAAkpABAg=="])
def test_settings_with_a_map_that_cant_be_read_are_refused(text):
    with pytest.raises(ValueError, match="a map from before can't be read"):
        PriorMap.from_text(text)
    with pytest.raises(ValueError):
        FusionConfig.model_validate({"map": {"priors": {"0": text}}})


def test_a_replays_fusion_has_it_too(tmp_path):
    """It gets its settings from the recording's, as `cli.replay.maps` makes them."""
    settings = FusionSettings(store=str(tmp_path / "s"), map=with_prior().map.model_dump())
    prior = settings.core().map.prior_of("0")
    assert prior is not None
    np.testing.assert_array_equal(prior.nav2_map.cells, nav2_map().cells)
