"""A camera's mask zones in the maps: what they hide is unknown, not free."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from surveilnav.services.fusion.core import JointMap

EDGE_Y_M = 2.0


@pytest.fixture
def halves(tools):
    """(maps of a view, maps of the same with its right half masked): from (0.5, 2) along +x, right is y < 2."""
    world = tools.world(boxes={"left": ((3, 2.6, 0), (3.5, 3.2, 1)), "right": ((3, 0.8, 0), (3.5, 1.4, 1))})
    view = world.view(0.5, EDGE_Y_M, 0.0, -0.3, height=1.8, source="camera/c1")
    found = tools.seen(*(world.detect(view, name, "tv", 0.9, tools.unit(0)) for name in ("left", "right")))
    hidden = np.zeros(view.depth_m.shape, np.bool_)
    hidden[:, view.depth_m.shape[1] // 2 :] = True
    masked = replace(
        view,
        depth_m=np.where(hidden, np.float32(0), view.depth_m),
        rgb=np.where(hidden[..., None], np.uint8(0), view.rgb),
    )
    maps = JointMap(), JointMap()
    for joint, seen in zip(maps, (view, masked), strict=True):
        joint.integrate(seen, found)  # at worst, a detector sees things in the black
    return maps


def known(joint: JointMap, layer: str, text: np.ndarray | None = None) -> np.ndarray:
    """(N, 2): the places of cells that a layer knows of."""
    grid, cells = joint.layer("0", layer, text) if text is not None else joint.layer("0", layer)
    rows = np.argwhere(np.isfinite(cells) if layer == "value" else cells)
    return grid.centres_of(rows)


@pytest.mark.parametrize("layer", ["explored", "occupancy", "frontier"])
def test_nothing_is_known_of_what_is_masked(halves, layer):
    whole, masked = halves
    side = known(masked, layer)
    assert (side[:, 1] > EDGE_Y_M - 0.11).all()
    assert len(side) > 20
    if layer != "frontier":
        assert (known(whole, layer)[:, 1] < EDGE_Y_M - 0.5).sum() > 20


def test_no_value_where_nothing_was_seen(halves, tools):
    whole, masked = halves
    assert (known(whole, "value", tools.unit(7))[:, 1] < EDGE_Y_M - 0.5).sum() > 20
    assert (known(masked, "value", tools.unit(7))[:, 1] > EDGE_Y_M - 0.11).all()


def test_no_object_and_no_point_comes_of_it(halves):
    whole, masked = halves
    assert [o.center_m[1] < EDGE_Y_M for o in whole.objects("0")] in ([False, True], [True, False])
    assert [o.center_m[1] < EDGE_Y_M for o in masked.objects("0")] == [False]
    assert (masked.layer("0", "cloud")[1][:, 1] > EDGE_Y_M - 0.11).all()
