"""Leasing slots over real Zenoh."""

from __future__ import annotations

from surveilnav.bus import lease as lease_module
from surveilnav.bus.lease import Slots
from surveilnav.contract import CAMERA_SLOT, FUSION_SLOT
from tests.waiting import until

NAMES = ["c1", "c2"]
CAMERAS = Slots(CAMERA_SLOT, "camera")


def test_each_gets_a_slot_of_its_own_and_gives_it_back(bus, make_node):
    watcher = make_node("test", "t", alive=False)
    with CAMERAS.lease(NAMES, bus) as first:
        name, node = first
        assert (node.kind, node.id) == ("camera", name)
        with CAMERAS.lease(NAMES, bus) as second:
            assert {name, second[0]} == {"c1", "c2"}
            until(lambda: watcher.alive("camera") == {"c1", "c2"})
            with CAMERAS.lease(NAMES, bus, wait_s=0.5) as third:
                assert third is None, "all are taken"
            assert not node.stopping.is_set()
        with CAMERAS.lease(NAMES, bus) as again:
            assert again[0] == second[0], "what is given back is free at once"
    assert node.stopping.is_set()


def test_slots_of_another_kind_are_other_slots(bus):
    with CAMERAS.lease(["low"], bus) as camera, Slots(FUSION_SLOT, "fusion").lease(["low"], bus) as fusion:
        assert (camera[1].kind, fusion[1].kind) == ("camera", "fusion")
        assert (camera[0], fusion[0]) == ("low", "low")


def test_a_process_that_waits_takes_a_slot_that_is_added_later(bus, monkeypatch, capsys):
    monkeypatch.setattr(lease_module, "_WAIT_S", 0.1)
    listed = iter([[], []])
    with CAMERAS.take(lambda: next(listed, ["c3"]), bus, "cameras.yaml") as (name, _):
        assert name == "c3"
    assert capsys.readouterr().err == "camera: all 0 of cameras.yaml are taken; waiting for one\n"
