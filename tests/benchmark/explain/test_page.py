"""The page that explains a run, what it refuses, and what the command prints."""

from __future__ import annotations

import json

import msgspec
import pytest
from typer.testing import CliRunner

from surveilnav.benchmark.explain.groups import GROUPINGS, kind_of
from surveilnav.benchmark.explain.make import explain
from surveilnav.benchmark.explain.page import headline
from surveilnav.benchmark.explain.runs import ExplainableRun, gain_of
from surveilnav.benchmark.play.approach import Approach
from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.records import Records
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.cli.main import app
from surveilnav.errors import ConfigError
from tests.benchmark.runner.test_records import BASIS, old_run


def search(number, **changes):
    """A search of 4 m in 8 m: near after 5 m with 3 m left, so 4 m were driven too far before."""
    from tests.benchmark.runner.test_records import RECORD

    near = Approach(
        closest_m=0.0, first_near_path_m=5.0, first_near_left_m=3.0, last_near_path_m=5.0, last_near_left_m=3.0
    )
    usual = {"spl": 0.5, "path_m": 8.0, "shortest_path_m": 4.0, "approach": near, "scene": "office_3-s0"}
    return msgspec.structs.replace(RECORD, **{**usual, "episode_id": str(number), **changes})


def failed(number, closest_m, **changes):
    first = 1.0 if closest_m <= 3.0 else None
    approach = Approach(closest_m=closest_m, first_near_path_m=first, first_near_left_m=first and 2.0)
    usual = {"success": False, "spl": 0.0, "reason": "not_seen", "approach": approach}
    return search(number, **{**usual, **changes})


SEARCHES = [
    search(0, camera_chance=0.9),
    failed(1, 4.0, camera_chance=0.0),
    failed(2, 2.0, camera_chance=0.3, reason="false_positive", scene="flats_3-s0"),
    search(3, camera_chance=0.5, category="bed", scene="1_bedroom-s1", spl=1.0, path_m=4.0),
]


def keep(folder, records=SEARCHES, settings=None, basis=BASIS):
    run = Records(folder, settings or RunSettings(), basis)
    for record in records:
        run.add(record)
    return folder


# --- words --------------------------------------------------------------------------------------------------------


def test_the_first_sentence_says_where_most_is_lost():
    assert headline(SEARCHES) == (
        "Of the 62.5 points that are missing to an SPL of 100, 25.0 go on searches that fail without ever coming near a goal, "
        "25.0 on searches that come near a goal and fail and 12.5 on the way before the robot first comes near a goal."
    )
    assert headline(SEARCHES[:1]).endswith("50.0 go on the way before the robot first comes near a goal.")
    assert headline(SEARCHES[3:]) == "Nothing is lost: the SPL of these 1 searches is 100.0."


def test_a_page_says_what_the_records_say(tmp_path):
    explained = explain(keep(tmp_path / "val-1"), [])
    assert (explained.page, explained.picture) == (tmp_path / "val-1.md", tmp_path / "val-1.png")
    assert explained.picture.read_bytes().startswith(b"\x89PNG")
    text = explained.page.read_text()
    assert text.startswith("# Where SPL is lost: val-1\n\n**Of the 62.5 points")
    assert "![Where SPL is lost](val-1.png)" in text
    for line in (
        "| never near | 1 | 25.0 [0.0, 50.0] | 40% |",
        "| way before | 1 | 12.5 [0.0, 25.0] | 20% |",
        "| together | 3 | 62.5 [",
        "| `not_seen` | 25.0 (1) | 0.0 (0) |",
        "| `false_positive` | 0.0 (0) | 25.0 (1) |",
        "| with a chance of 50% or more | 2 | 100.0 [100.0, 100.0] | 75.0 [50.0, 100.0] | 20% | 0.0 [0.0, 0.0] |",
        "| not at all | 1 | 0.0 [0.0, 0.0] | 0.0 [0.0, 0.0] | 40% | 100.0 [100.0, 100.0] | 0.0 [0.0, 0.0] |",
        "| apartment houses (generated) | 1 |",
        "| bed | 1 | 100.0 [100.0, 100.0] | 100.0 [100.0, 100.0] | 0% |",
    ):
        assert line in text
    assert "No bound was named" in text
    folder = tmp_path / "val-1"
    assert sorted(p.name for p in folder.iterdir()) == ["searches.csv", "settings.json"], (
        "a run can be published as it is"
    )


def test_every_group_holds_each_search_once():
    for grouping in GROUPINGS:
        found = grouping.groups(SEARCHES)
        assert sorted(r.episode_id for some in found.values() for r in some) == ["0", "1", "2", "3"]
    by_cameras = GROUPINGS[0].groups([*SEARCHES, search(4, camera_chance=None)])
    assert list(by_cameras) == [
        "with a chance of 50% or more",
        "with a chance below 50%",
        "not at all",
        "no cameras took part",
    ]


@pytest.mark.parametrize(
    ("grouping", "change", "group"),
    [
        (3, {"shortest_path_m": 5.0}, "up to 5 m"),
        (3, {"shortest_path_m": 5.01}, "over 5 to 10 m"),
        (3, {"shortest_path_m": 30.0}, "over 20 m"),
        (4, {"steps": 50}, "up to 50 steps"),
        (4, {"steps": 51}, "over 50 to 100 steps"),
        (4, {"steps": 500}, "over 200 steps"),
    ],
)
def test_spans(grouping, change, group):
    assert GROUPINGS[grouping].group_of(search(0, **change)) == group


def test_kinds_are_read_from_the_scenes_name():
    assert kind_of("office_3-s0") == "offices (generated)"
    assert kind_of("1_bedroom-s1") == kind_of("scan-s0") == "homes and others that people drew"


# --- bounds -------------------------------------------------------------------------------------------------------


def test_a_bound_gains_what_its_searches_have_more(tmp_path):
    """Search 1 is found, search 2 isn't played; of the others nothing changes."""
    better = [SEARCHES[0], search(1), SEARCHES[3]]
    bound = keep(tmp_path / "bound", better, RunSettings(policy="perfect-frontiers", surveillance=False))
    run = ExplainableRun.read(keep(tmp_path / "run"))
    gain = gain_of(ExplainableRun.read(bound), run)
    assert gain.label == "policy perfect-frontiers, surveillance off"
    assert gain.difference.pairs == 3
    assert gain.difference.spl.mean == pytest.approx(50.0 / 3)
    assert [i.mean for i in gain.by_part] == pytest.approx([100.0 / 3, 0.0, -50.0 / 3, 0.0, 0.0])
    text = explain(tmp_path / "run", [bound], tmp_path / "pages" / "why.md").page.read_text()
    assert "| policy perfect-frontiers, surveillance off | 3 | 100.0 / 66.7 | +33.3 [" in text
    assert (tmp_path / "pages" / "why.png").exists()


def test_a_bound_of_other_searches_is_refused(tmp_path):
    run = ExplainableRun.read(keep(tmp_path / "run"))
    other = keep(tmp_path / "other", basis=Basis("another", BASIS.program))
    with pytest.raises(ConfigError, match=r"other is no bound of .*run: it was played on another dataset"):
        gain_of(ExplainableRun.read(other), run)
    apart = keep(tmp_path / "apart", [search(99)])
    with pytest.raises(ConfigError, match="no search in common"):
        gain_of(ExplainableRun.read(apart), run)
    older = keep(tmp_path / "older", basis=Basis(BASIS.dataset, "older"))
    assert gain_of(ExplainableRun.read(older), run).label == "the same settings (program older)"


# --- what can't be explained --------------------------------------------------------------------------------------


def test_an_old_run_has_to_be_played_again_and_is_named(tmp_path):
    run, old = keep(tmp_path / "run"), old_run(tmp_path / "old")
    for folder, bounds in ((old, []), (run, [old])):
        with pytest.raises(ConfigError, match=r"the run .*old can't be explained.*closest_m.*camera_chance.*again"):
            explain(folder, bounds)
    assert not list(tmp_path.glob("*.md"))


def test_a_run_without_a_search_or_that_isnt_there_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="holds no search yet"):
        explain(keep(tmp_path / "run", []), [])
    with pytest.raises(ConfigError, match="holds no run"):
        explain(tmp_path / "nowhere", [])


def test_a_page_that_cant_be_written_says_so(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="choose another --out"):
        explain(keep(tmp_path / "run"), [], tmp_path / "file" / "page.md")


# --- the command --------------------------------------------------------------------------------------------------


def test_the_command_says_it_in_words_and_as_json(tmp_path):
    run = keep(tmp_path / "run")
    bound = keep(tmp_path / "bound", settings=RunSettings(camera_perception="oracle"))
    said = CliRunner().invoke(app, ["bench", "explain", str(run), "--bound", str(bound)])
    assert said.exit_code == 0
    lines = said.stdout.splitlines()
    assert lines[0] == headline(SEARCHES)
    assert lines[1].startswith("4 searches: SR 50.0 [")
    assert any(line.split() == ["never", "near", "25.0", "[0.0,", "50.0]"] for line in lines)
    assert "with camera perception oracle: SPL +0.0 [+0.0, +0.0], SR +0.0 [+0.0, +0.0] in 4 searches" in lines
    numbers = json.loads(CliRunner().invoke(app, ["bench", "explain", str(run), "--json"]).stdout)
    assert numbers["searches"] == 4
    assert numbers["missing"]["before"] == [12.5, 0.0, 25.0]
    assert numbers["groups"]["By target"]["bed"]["spl"] == [100.0, 100.0, 100.0]
    assert numbers["bounds"] == []
