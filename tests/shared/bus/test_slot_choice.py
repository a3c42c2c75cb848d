from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from surveilnav.bus.slot_choice import choose_slot, keeps_slot

names = st.sampled_from("abcdefghij")


@given(st.sets(names), st.lists(names, unique=True), st.text(min_size=1, max_size=8))
def test_a_slot_is_free_and_exists(taken: set[str], slots: list[str], node: str) -> None:
    slot = choose_slot(slots, taken, node)
    if slot is None:
        assert set(slots) <= taken
    else:
        assert slot in set(slots) - taken
        assert slot == choose_slot(slots, taken, node)


def test_replicas_begin_at_different_slots_and_one_of_two_rivals_yields() -> None:
    assert len({choose_slot("abcdefgh", set(), f"node-{k}") for k in range(20)}) > 4
    assert keeps_slot("a", ["b", "c"])
    assert not keeps_slot("b", ["a"])
    assert keeps_slot("a", [])
    assert sum(keeps_slot(me, [n for n in "abc" if n != me]) for me in "abc") == 1
