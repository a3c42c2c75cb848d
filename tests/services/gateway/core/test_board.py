"""The board: of each thing the newest state, in the order of their changes, whoever was away."""

from __future__ import annotations

import json

from hypothesis import given
from hypothesis import strategies as st

from surveilnav.services.gateway.core.board import _MOST_GONE, Board

CHANGES = st.lists(
    st.tuples(st.sampled_from(["robot", "camera"]), st.sampled_from("abc"), st.one_of(st.none(), st.integers(0, 3))),
    max_size=40,
)


def read(board: Board, number: int, shown: dict, limit: int = 2) -> int:
    """Takes in what changed, a few rows at a time; where the reader then is."""
    while rows := board.after(number, limit=limit):
        for row in rows:
            data = json.loads(row.data)
            shown[row.kind, data["id"]] = data["state"]
        number = rows[-1].number
    return number


@given(CHANGES, st.lists(st.integers(0, 40), max_size=4))
def test_whenever_a_reader_looks_it_knows_the_newest_state_of_everything(changes, looks):
    board, truth, shown, number = Board("e"), {}, {}, 0
    for at, (kind, id, state) in enumerate(changes):
        told = board.show(kind, id, None if state is None else json.dumps(state))
        assert told == (truth.get((kind, id)) != state)
        if state is not None or (kind, id) in truth:
            truth[kind, id] = state
        if at in looks:
            number = read(board, number, shown)
            assert shown == truth
    read(board, number, shown)
    assert shown == truth


def test_who_comes_back_gets_what_changed_and_who_is_a_stranger_gets_all():
    board = Board("e")
    board.show("robot", "r1", "1")
    board.show("robot", "r2", "1")
    board.show("robot", "r1", "2")
    assert [r.number for r in board.after(board.position("e-2").number)] == [3]
    for id in (None, "", "e-", "e-99", "other-2", "e-2\n"):
        position = board.position(id)
        assert position.number == 0, id
        assert position.gap, id
    assert [json.loads(r.data) for r in board.after(0)] == [{"id": "r2", "state": 1}, {"id": "r1", "state": 2}]
    assert [json.loads(r.data)["id"] for r in board.after(0, {"r2"})] == ["r2"]


def test_what_is_gone_is_told_and_takes_no_memory_for_ever():
    board = Board("e")
    for n in range(_MOST_GONE + 50):
        board.show("object", str(n), "1")
        board.show("object", str(n), None)
    rows = board.after(0, limit=10**6)
    assert len(rows) == _MOST_GONE
    assert all(json.loads(r.data)["state"] is None for r in rows)


def test_an_id_is_a_string_of_json_whatever_is_in_it():
    board = Board("e")
    board.show("mission", 'a"\\\n', "{}")
    assert json.loads(board.after(0)[0].data)["id"] == 'a"\\\n'
    assert "\n" not in board.after(0)[0].data
