"""The page of other people's homes: true to what ``surveilnav homes`` and the runs say."""

from __future__ import annotations

import json

import pytest

from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.studies import others
from surveilnav.errors import ConfigError

WHOLE = {
    "file": "a/home.sh3d",
    "levels": [{}, {}],
    "rooms": 3,
    "free_m2": 20.0,
    "reached_m2": 18.0,
    "reached_open_m2": 19.0,
    "targets": {"bed": [1, 1], "chair": [2, 3]},
    "says": "",
    "notes": [],
}
HALF = WHOLE | {
    "reached_m2": 10.0,
    "reached_open_m2": 10.0,
    "says": "robots reach 10 of 20 m²: no stair leads to level 1",
    "targets": {},
}
NOBODY = others.Index(None)
OLD = {"file": "a/home.sh3d", "error": "no Home.xml | `inside`"}


def search(**changes):
    facts = {
        "scene": "home-s0",
        "episode_id": "4",
        "category": "bed",
        "success": False,
        "spl": 0.0,
        "soft_spl": 0.1,
        "steps": 9,
        "path_m": 3.0,
        "shortest_path_m": 2.0,
        "distance_m": 1.25,
        "reason": "false_positive",
        "seen": True,
        "bytes": {},
        "seconds": 1.0,
    }
    return EpisodeRecord(**(facts | changes))


@pytest.fixture
def index(tmp_path):
    path = tmp_path / "names.tsv"
    path.write_text(
        "owner/repo\tpath\tfile\tleft_out\nann/flat\tplans/home.sh3d\ta/home.sh3d\t\nbob/x\tX.sh3d\tb.sh3d\tan example home\n"
    )
    return others.Index(path)


def test_before_and_after_stand_side_by_side(index):
    text = others.page({"a/home.sh3d": HALF}, {"a/home.sh3d": WHOLE}, index, {})
    assert "**In 1 of 1 homes robots reach at least 85% of the free floor; before in 0.**" in text
    row = "| ann/flat: plans/home.sh3d | 2 | 3 | 10 of 20 | 50 | 18 of 20 | 90 | 95 | 0 of 0 | 3 of 4 |"
    assert row in text.splitlines()
    assert "no stair" not in text
    assert "## Searches" not in text


def test_what_is_missing_has_its_reason_and_strange_words_no_markup():
    text = others.page({"a/home.sh3d": OLD}, {"a/home.sh3d": HALF}, NOBODY, {})
    assert "| a/home.sh3d | 2 | 3 | can't be read |  | 10 of 20 | 50 | 50 |  | 0 of 0 |" in text.splitlines()
    assert "| a/home.sh3d | no stair leads to level 1 |" in text.splitlines()
    assert "| a/home.sh3d | no Home.xml / 'inside' |" in others.page({}, {"a/home.sh3d": OLD}, NOBODY, {}).splitlines()


def test_copies_and_what_is_left_out_by_name_dont_count(index):
    same = {"sha256": "f00"}
    after = {"a/home.sh3d": WHOLE | same, "b.sh3d": WHOLE, "c.sh3d": HALF | same}
    text = others.page({}, after, index, {})
    assert "**In 1 of 1 homes" in text
    assert "| bob/x: X.sh3d | an example home |" in text.splitlines()
    assert "| c.sh3d | the same bytes as ann/flat: plans/home.sh3d |" in text.splitlines()


def test_the_bar_is_held_against_what_the_plans_doors_lead_to():
    shut = HALF | {"reached_open_m2": 18.0}
    text = others.page({}, {"a": WHOLE, "b": HALF, "c": shut}, NOBODY, {})
    assert (
        "In 2 homes the plan's own doors and stairs lead to so much, if all doors stood open: robots reach it in 1."
        in text
    )


def test_plans_drawn_for_a_fault_have_a_line_each():
    text = others.page({}, {"a": WHOLE}, NOBODY, {}, ({"low.sh3d": OLD}, {"low.sh3d": HALF}))
    assert "| low | can't be read | 10 |  | 0 of 0 |" in text.splitlines()


def test_every_failed_search_has_its_cause():
    runs = {"on": [search(success=True, spl=0.5), search(distance_m=None)], "off": [search(seen=False)]}
    taken = {"on": {("home-s0", "4"): "oven (Backofen | <b>)"}}
    lines = others.page({}, {"a/home.sh3d": WHOLE}, NOBODY, runs, taken=taken).splitlines()
    assert "| home-s0 | 1 of 2 | 25.0 | 0 of 1 | 0.0 |" in lines
    assert "| false_positive | 1 | 1 |" in lines
    assert "| home-s0 | 4 | bed | on | false_positive | oven (Backofen / &lt;b>) | yes | no way |" in lines
    assert "| home-s0 | 4 | bed | off | false_positive |  | no | 1.2 |" in lines


def test_the_command_writes_the_page(tmp_path):
    said, index = tmp_path / "said.json", tmp_path / "index.tsv"
    said.write_text(json.dumps({"homes": [WHOLE]}))
    index.write_text("owner/repo\tpath\tfile\tleft_out\nann/flat\thome.sh3d\ta/home.sh3d\t\n")
    out = tmp_path / "page.md"
    assert others.main([str(said), str(said), "--index", str(index), "--out", str(out)]) == 0
    assert "ann/flat: home.sh3d" in out.read_text()
    index.write_text("name\nx\n")
    with pytest.raises(ConfigError, match="no column"):
        others.Index(index)
    said.write_text("[]")
    with pytest.raises(ConfigError, match="isn't what"):
        others.survey_of(said)
