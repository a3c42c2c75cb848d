"""Views for the depth network: their geometry agrees with their depth, and they survive their file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from surveilnav.config import cache_dir
from surveilnav.errors import PerceptionError
from surveilnav.perception.depth import reference_depth
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.navigation import NavigationMap
from training.depth.floor import floor_mask
from training.depth.pack import SUFFIX, DepthView, read_packs, write_pack
from training.depth.views import SIDE_PX, ViewSource


@pytest.fixture(scope="module")
def views() -> list[DepthView]:
    scene = open_building("parametric_flat")
    return list(ViewSource(scene, NavigationMap.load_or_build(scene, cache_dir()), "flat").views(8, seed=1))


def test_floors_have_the_reference_depth(views: list[DepthView]) -> None:
    shares = []
    for view in views:
        camera, pose = view.geometry.camera(SIDE_PX), view.geometry.pose()
        true = reference_depth(camera, pose, 0.0)
        depth_m = view.depth_m.astype(np.float32)
        # Nothing lies below a flat's floor. float16 rounds depth by a thousandth.
        known = true.floor & (depth_m > 0)
        assert (depth_m[known] <= 1.002 * true.depth_m[known]).all()
        shares.append(floor_mask(depth_m, true.depth_m, true.floor, true.height_m).mean())
        assert 1.7 < view.geometry.height_m < 3.0
    assert np.mean(shares) > 0.05


def test_views_survive_their_file(views: list[DepthView], tmp_path: Path) -> None:
    write_pack(tmp_path / f"flat{SUFFIX}", "flat", SIDE_PX, views)
    (pack,) = read_packs(tmp_path)
    for i, view in enumerate(views):
        kept = pack.view(i)
        assert kept.geometry == view.geometry
        np.testing.assert_array_equal(kept.depth_m, view.depth_m)
        assert np.abs(kept.rgb.astype(float) - view.rgb).mean() < 8.0


def test_a_folder_without_views_says_how_to_make_them(tmp_path: Path) -> None:
    with pytest.raises(PerceptionError, match=r"training\.depth\.make_views"):
        read_packs(tmp_path)
