"""What is published: every run is one that a table asks for, and every page is made of what lies beside it."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import msgspec
import pytest

from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.records import read_facts, stored_run
from surveilnav.benchmark.runner.settings import RunSettings, run_id
from surveilnav.benchmark.tables.arms import TABLES
from surveilnav.benchmark.tables.page import TableRow, page

BENCH = Path(__file__).parents[3] / "docs" / "results" / "bench"
FOLDERS = sorted(p for records in BENCH.glob("**/records") for p in records.iterdir())


def test_every_run_is_one_that_a_table_asks_for_under_its_name():
    asked = {run_id(settings): settings for table in TABLES.values() for arm in table.arms for settings in arm.runs}
    for folder in FOLDERS:
        facts = read_facts(folder)
        assert folder.name in asked, (
            "was a setting renamed? then its name changes in settings.json and the folder's too"
        )
        assert msgspec.convert(facts["settings"], RunSettings) == asked[folder.name]
    assert len(FOLDERS) == 18


def test_a_run_is_one_small_table():
    for folder in FOLDERS:
        assert sorted(p.name for p in folder.iterdir()) == ["searches.csv", "settings.json"]
        assert (folder / "searches.csv").stat().st_size <= 150_000


@pytest.mark.parametrize(("edition", "name"), [("v1", "main"), ("v2", "main"), ("v2", "pixels")])
def test_a_page_says_what_its_tables_say(edition, name):
    """But for the furniture models, which only the dataset knows."""
    folder, table, lines, bases = BENCH / "v1" if edition == "v1" else BENCH, TABLES[name], [], set()
    for arm in table.arms:
        (settings,) = arm.runs
        run = folder / "records" / run_id(settings)
        if (facts := read_facts(run)) is not None:
            basis = Basis(facts["dataset"], facts["program"])
            bases.add(basis)
            lines.append(TableRow.from_records(arm, stored_run(run, settings, basis).records))
    (basis,) = bases
    made = page(table, lines, 1000, defaultdict(list), basis, edition)
    written = (folder / f"{name}.md").read_text()
    if edition == "v1":  # a note stands below the title
        title, note, rest = written.split("\n\n", 2)
        assert note.startswith("**Of dataset v1.**")
        written = f"{title}\n\n{rest}"
    parts = [text.partition("## By furniture model")[0] for text in (made, written)]
    assert parts[0] == parts[1]
    assert "## By category" in parts[0]


def test_no_picture_is_there_twice():
    pictures = defaultdict(list)
    for path in sorted(BENCH.parent.rglob("*.png")):
        pictures[path.read_bytes()].append(path.name)
    assert [names for names in pictures.values() if len(names) > 1] == []
