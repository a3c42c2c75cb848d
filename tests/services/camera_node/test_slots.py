"""Leasing slots of a camera plan over real Zenoh."""

from __future__ import annotations

import pytest

from surveilnav.camera_plan import CameraPlan, PlannedCamera
from surveilnav.errors import ConfigError
from surveilnav.geometry import Pinhole
from surveilnav.services.camera_node.slots import find_camera, lease
from tests.waiting import until

PLAN = CameraPlan(
    "home",
    "hash",
    ["0"],
    1.8,
    Pinhole.from_hfov(64, 64, 1.0),
    [PlannedCamera(name, "0", (0.0, 0.0, 1.8), []) for name in ("c1", "c2")],
)


def test_each_gets_a_camera_of_its_own_and_gives_it_back(bus, make_node):
    watcher = make_node("test", "t", alive=False)
    with lease(PLAN, bus) as first:
        camera, node = first
        assert (node.kind, node.id) == ("camera", camera.name)
        with lease(PLAN, bus) as second:
            assert {camera.name, second[0].name} == {"c1", "c2"}
            until(lambda: watcher.alive("camera") == {"c1", "c2"})
            with lease(PLAN, bus, wait_s=0.5) as third:
                assert third is None, "all are taken"
            assert not node.stopping.is_set()
        with lease(PLAN, bus) as again:
            assert again[0].name == second[0].name, "what is given back is free at once"
    assert node.stopping.is_set()


def test_a_camera_by_name():
    assert find_camera(PLAN, "c2") is PLAN.cameras[1]
    with pytest.raises(ConfigError, match=r"no camera 'c9' .* \['c1', 'c2'\]"):
        find_camera(PLAN, "c9")
