"""Leasing slots over real Zenoh."""

from __future__ import annotations

import threading
from contextlib import ExitStack

from hypothesis import given
from hypothesis import strategies as st

from surveilnav.bus import Node
from surveilnav.bus import lease as lease_module
from surveilnav.bus.lease import choose_slot, lease_slot, take_slot
from tests.waiting import until

NAMES = ["c1", "c2"]
some_names = st.sampled_from("abcdefghij")


@given(st.sets(some_names), st.lists(some_names, unique=True), st.text(min_size=1, max_size=8))
def test_a_slot_is_free_and_exists(taken: set[str], slots: list[str], process_id: str) -> None:
    slot = choose_slot(slots, taken, process_id)
    if slot is None:
        assert set(slots) <= taken
    else:
        assert slot in set(slots) - taken
        assert slot == choose_slot(slots, taken, process_id)


def test_replicas_begin_at_different_slots() -> None:
    assert len({choose_slot("abcdefgh", set(), f"process-{k}") for k in range(20)}) > 4


def test_each_gets_a_slot_of_its_own_and_gives_it_back(bus, make_node):
    watcher = make_node("test", "t", alive=False)
    with lease_slot("camera", NAMES, bus) as first:
        name, node = first
        assert (node.kind, node.id) == ("camera", name)
        with lease_slot("camera", NAMES, bus) as second:
            assert {name, second[0]} == {"c1", "c2"}
            until(lambda: watcher.alive("camera") == {"c1", "c2"})
            with lease_slot("camera", NAMES, bus, wait_s=0.5) as third:
                assert third is None, "all are taken"
            assert not node.stopping.is_set()
        with lease_slot("camera", NAMES, bus) as again:
            assert again[0] == second[0], "what is given back is free at once"
    assert node.stopping.is_set()


def test_slots_of_another_kind_are_other_slots(bus):
    with lease_slot("camera", ["low"], bus) as camera, lease_slot("fusion", ["low"], bus) as fusion:
        assert (camera[1].kind, fusion[1].kind) == ("camera", "fusion")
        assert (camera[0], fusion[0]) == ("low", "low")


def test_those_that_choose_the_same_slot_at_once_end_with_one_each(bus, monkeypatch):
    """None of them knows of the others when it chooses for the first time, and all begin at the same slot."""
    monkeypatch.setattr(lease_module.zlib, "crc32", lambda _: 0)
    present, n, chosen = Node.alive, 3, threading.Barrier(3)
    asked: set[Node] = set()

    def knows_nothing_at_first(self, kind):
        if self in asked:
            return present(self, kind)
        asked.add(self)
        chosen.wait(20)
        return set()

    monkeypatch.setattr(Node, "alive", knows_nothing_at_first)
    taken, leaves, problems = [], threading.Event(), []

    def take():
        try:
            with ExitStack() as stack:
                name, node = stack.enter_context(take_slot("camera", lambda: ["c1", "c2", "c3"], bus, "a list"))
                taken.append(name)
                leaves.wait(30)
                if node.stopping.is_set():
                    problems.append(f"{name} had to leave")
        except Exception as error:
            problems.append(repr(error))

    threads = [threading.Thread(target=take) for _ in range(n)]
    for thread in threads:
        thread.start()
    try:
        until(lambda: len(taken) + len(problems) >= n, timeout_s=30.0)
    finally:
        leaves.set()
        for thread in threads:
            thread.join(20)
    assert not problems
    assert sorted(taken) == ["c1", "c2", "c3"]


def test_a_name_that_is_refused_is_not_asked_for_again_while_others_are_free(bus, monkeypatch):
    """As with rules by which a process doesn't see the others."""
    monkeypatch.setattr(lease_module.zlib, "crc32", lambda _: 0)
    monkeypatch.setattr(Node, "alive", lambda self, kind: set())
    with lease_slot("camera", NAMES, bus) as one, lease_slot("camera", NAMES, bus) as other:
        assert (one[0], other[0]) == ("c1", "c2")


def test_a_process_that_waits_takes_a_slot_that_is_added_later(bus, monkeypatch, capsys):
    monkeypatch.setattr(lease_module, "_WAIT_S", 0.1)
    listed = iter([[], []])
    with take_slot("camera", lambda: next(listed, ["c3"]), bus, "cameras.yaml") as (name, _):
        assert name == "c3"
    assert capsys.readouterr().err == "camera: all 0 of cameras.yaml are taken; waiting for one\n"
