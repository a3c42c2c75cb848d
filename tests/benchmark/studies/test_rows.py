"""A study's file of rows: they are told apart by their key."""

from __future__ import annotations

from surveilnav.benchmark.studies.rows import RowsFile

ROW = {"home": "studio", "arm": "on", "program": "this", "spl": 0.5}


def test_a_second_start_finds_what_is_done(tmp_path):
    rows = RowsFile(tmp_path / "rows.jsonl", ("home", "arm"))
    assert rows.load() == []
    assert rows.done() == frozenset()
    rows.append(ROW)
    rows.append(ROW | {"arm": "off", "program": "another"})
    assert rows.key_of(ROW) == ("studio", "on")
    assert rows.done() == {("studio", "on"), ("studio", "off")}
    assert rows.done() == {("studio", "on"), ("studio", "off")}
    assert RowsFile(rows.path, rows.key).load()[0] == ROW


def test_a_line_that_cant_be_read_costs_only_itself(tmp_path):
    rows = RowsFile(tmp_path / "rows.jsonl", ("home",))
    rows.append(ROW)
    with rows.path.open("ab") as file:
        file.write(b"\xff{\n")
    rows.append(ROW | {"home": "flat"})
    assert [r["home"] for r in rows.load()] == ["studio", "flat"]
