"""The study of the running system: what it makes of rows, and of what ``demo`` says."""

from __future__ import annotations

import stat
import sys
from pathlib import Path

import pytest

from surveilnav.benchmark.studies import live
from surveilnav.benchmark.studies.live import Search, page, pairs_of, play


def row(building: str, arm: str, *, seed: int = 0, **facts: object) -> dict:
    known = {
        "building": building,
        "seed": seed,
        "target": "tv",
        "surveillance": arm,
        "success": True,
        "spl": 0.5,
        "path_m": 10.0,
        "shortest_path_m": 5.0,
        "search_s": 20.0,
        "first_action_s": 1.0,
        "steps": 90,
        "program": "abc",
        "models": "all",
    }
    return known | facts


def test_only_starts_that_were_played_both_ways_are_compared():
    rows = [row("a", "on"), row("a", "off"), row("b", "on"), row("c", "on", skipped="no tv"), row("c", "off")]
    assert [(on["building"], off["building"]) for on, off in pairs_of(rows)] == [("a", "a")]


def test_the_page_says_what_cameras_change():
    rows = [
        row("a", "on", spl=0.9, search_s=10.0),
        row("a", "off", spl=0.4),
        row("b", "on", spl=0.7, search_s=30.0, first_action_s=2.5),
        row("b", "off", spl=0.6, success=False),
    ]
    said = page(rows, "the command")
    assert "2 starts in 2 buildings" in said
    assert "Cameras change SPL by +30.0 [+10.0, +50.0]" in said
    assert "success by +50.0" in said
    assert "takes 1.00 times as long" in said  # half as long, and one and a half times
    assert "2.5 s at most" in said
    assert "| b | 0 | tv | yes / no | 10.0 / 10.0 | 5.0 | 30.0 / 20.0 | 2.5 / 1.0 |" in said


def test_without_a_pair_the_page_says_how_often_it_ends_right():
    rows = [
        row("a", "on", found=True),
        row("a", "on", seed=1, success=False, spl=0.0, found=False, error="out_of_steps"),
    ]
    said = page([r | {"error": r.get("error")} for r in rows], "c")
    assert "**1 of 2 searches end right (50 %), SPL 25.0.** Buildings and seeds: 2; cameras: on." in said
    assert "| tv | 2 | 1 | 25.0 |" in said
    assert "| a | 1 | tv | no | out_of_steps | 90 | 10.0 | 5.0 | 20.0 |" in said
    assert (
        "Made by `c`, program abc. Training saw none of these plans. Furniture is of training and held-out models."
        in said
    )


def test_the_page_says_what_isnt_held_out():
    said = page(
        [row("3_bedroom", "on", found=True, error=None, models="val"), row("studio", "on", skipped="no tv")], "c"
    )
    assert "Training saw the plans of 3_bedroom. Furniture is of held-out models." in said


def test_without_a_row_the_page_says_so():
    assert "Nothing was played yet." in page([row("a", "on", skipped="no tv")], "c")


def test_the_command_on_the_page_is_the_one_that_was_given():
    given = ["--buildings", "a", "b", "--targets", "tv", "potted plant", "--models", "val", "--table"]
    parser = live._parser()
    said = live._command(parser, parser.parse_args(given))
    assert (
        said == 'python -m surveilnav.benchmark.studies.live --buildings a b --targets tv "potted plant" --models val'
    )


@pytest.fixture
def demo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """``surveilnav`` is a script of the line of Python that it is given."""
    script, python = tmp_path / "surveilnav", sys.executable

    def runs(line: str) -> None:
        script.write_text(f"#!{python}\nimport json, os\n{line}\n")
        script.chmod(script.stat().st_mode | stat.S_IXUSR)

    monkeypatch.setattr(live.sys, "executable", str(tmp_path / "python"))
    return runs


@pytest.mark.parametrize(
    ("said", "skipped"),
    [
        ('{"error": {"message": "there is no tv"}}', "there is no tv"),
        ("Traceback", "JSONDecodeError: see runs"),
        ("", "IndexError: see runs"),
    ],
)
def test_what_cant_be_played_says_why(demo, said: str, skipped: str):
    demo(f"print({said!r})")
    assert play(Search("a", 0, "tv", "on"), "oracle", Path("runs"))["skipped"] == skipped


def test_what_was_played_is_kept(demo):
    demo("""print('{"success": true, "spl": 0.5, "report": "no number", "actions": ["stop"]}')""")
    found = play(Search("a", 3, "tv", "off"), "oracle", Path("runs"))
    assert (found["seed"], found["surveillance"], found["spl"], found["actions"]) == (3, "off", 0.5, ["stop"])
    assert "report" not in found


def test_demo_furnishes_with_the_models_that_were_named(demo):
    demo('print(json.dumps({"success": True, "message": os.environ["SURVEILNAV_SIM__MODELS"]}))')
    assert play(Search("a", 3, "tv", "off"), "oracle", Path("runs"), "val")["message"] == "val"
