"""Leasing cameras over real Zenoh."""

from __future__ import annotations

import pytest

from surveilnav.errors import ConfigError
from surveilnav.services.camera_node.lease import lease
from surveilnav.services.camera_node.taking import take_camera
from tests.waiting import until

NAMES = ["c1", "c2"]


def test_each_gets_a_camera_of_its_own_and_gives_it_back(bus, make_node):
    watcher = make_node("test", "t", alive=False)
    with lease(NAMES, bus) as first:
        name, node = first
        assert (node.kind, node.id) == ("camera", name)
        with lease(NAMES, bus) as second:
            assert {name, second[0]} == {"c1", "c2"}
            until(lambda: watcher.alive("camera") == {"c1", "c2"})
            with lease(NAMES, bus, wait_s=0.5) as third:
                assert third is None, "all are taken"
            assert not node.stopping.is_set()
        with lease(NAMES, bus) as again:
            assert again[0] == second[0], "what is given back is free at once"
    assert node.stopping.is_set()


def test_a_camera_by_name(bus):
    with take_camera("c2", lambda: NAMES, "cameras.yaml", bus) as (name, node):
        assert (name, node.id) == ("c2", "c2")
    with pytest.raises(ConfigError, match=r"no camera 'c9' in cameras\.yaml; it has \['c1', 'c2'\]"):  # noqa: SIM117
        with take_camera("c9", lambda: NAMES, "cameras.yaml", bus):
            pass


def test_a_process_that_waits_takes_a_camera_that_is_added_later(bus, make_node, monkeypatch):
    from surveilnav.services.camera_node import taking

    monkeypatch.setattr(taking, "_RETRY_S", 0.1)
    listed = iter([[], []])
    with take_camera("", lambda: next(listed, ["c3"]), "cameras.yaml", bus) as (name, _):
        assert name == "c3"
