"""Tables: every arm is a run that can be, pages say what the records say."""

from __future__ import annotations

import dataclasses
import errno
import io
from collections import defaultdict

import msgspec
import pytest

from surveilnav.benchmark.dataset.format import VERSION, Manifest, SplitCounts, write
from surveilnav.benchmark.dataset.splits import SPLITS
from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.records import Broken, Records
from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.runner.run import Finished
from surveilnav.benchmark.runner.settings import RunSettings, run_id
from surveilnav.benchmark.tables.arms import TABLES, Arm, Table
from surveilnav.benchmark.tables.make import expect_own_runs, make
from surveilnav.benchmark.tables.page import TableRow, _over_bytes, page, plot
from surveilnav.errors import ConfigError, SurveilNavError
from surveilnav.perception.models import CATALOGUE
from tests.benchmark.runner.test_records import FAILED, RECORD

ARMS = (Arm("with", RunSettings(), (67.4, 34.5)), Arm("without", RunSettings(surveillance=False)))
TABLE = Table("range", "Range", "About it.", ARMS)
BASIS = Basis("dataset-hash-of-64", "program-hash-of-64")
MODELS = {("flat-s0", "tv"): ["Maker#flat-tv", "Maker#wall-tv"]}


def test_every_arm_can_be_run_and_has_a_folder_of_its_own():
    for table in TABLES.values():
        for arm in table.arms:
            arm.settings.check()
            assert arm.settings.split in SPLITS
        names = [tuple(map(run_id, arm.runs)) for arm in table.arms]
        assert len(set(names)) == len(names), table.name
        assert all("/" not in name and len(name) <= 20 for name in sum(names, ()))
        assert len({arm.label for arm in table.arms}) == len(table.arms)
        assert table.arms[0].seeds == 1, "each search of a line has one of the first line beside it"


def test_arms_with_the_same_settings_share_a_run():
    assert TABLES["range"].arms[0].runs == TABLES["density"].arms[0].runs
    assert TABLES["agreement"].arms[0].runs == TABLES["detector"].arms[0].runs
    assert TABLES["strategy-pixels"].arms[0].runs == TABLES["tiers"].arms[0].runs


def test_a_line_of_several_seeds_is_of_all_their_searches(tmp_path, basis, played):
    arms = (
        Arm("pixels", RunSettings(perception="oracle")),
        Arm("both", RunSettings(), seeds=2),
        Arm("one", RunSettings(seed=1)),
    )
    keep(tmp_path, arms[1], basis, RECORD, msgspec.structs.replace(FAILED, spl=0.2))
    made = make(Table("agreement", "A", "About.", arms), tmp_path, tmp_path, workers=1, wanted=lambda arm: False)
    assert "| both | 2 (unfinished) |" in made.page.read_text()
    made = make(Table("agreement", "A", "About.", arms), tmp_path, tmp_path, workers=1)
    assert played == [RunSettings(perception="oracle"), RunSettings(), RunSettings(seed=1)]
    assert made.played == 3
    text = made.page.read_text()
    assert "| both | 4 | 50.0" in text
    assert "| one | 2 | 50.0" in text
    assert "(of" not in text


def test_a_page_says_what_the_records_say():
    without = [msgspec.structs.replace(RECORD, success=False, spl=0.0, reason="out_of_steps"), FAILED]
    text = page(
        TABLE,
        [TableRow.from_records(ARMS[0], [RECORD, FAILED]), TableRow.from_records(ARMS[1], without)],
        2,
        MODELS,
        BASIS,
    )
    assert "| with | 2 | 50.0 [0.0, 100.0] | 25.0 [0.0, 50.0] | 60.0 | " in text
    assert (
        "| without | 2 | 0.0 [0.0, 0.0] | 0.0 [0.0, 0.0] | 60.0 | -50.0 [-100.0, +0.0] | -25.0 [-50.0, +0.0] |  | "
        in text
    )
    assert "67.4 / 34.5" in text
    assert "program `program-hash`, dataset v2 `dataset-hash`" in text
    assert "| with | 1 (1) | 0 |" in text  # reasons
    assert "| without | 1 (1) | 0 | 0 | 0 | 0 | 0 | 0 | 1 (1) |" in text
    assert "SR at 0.2 m and 1 m" in text
    assert "within 0.1 m (geodesic)" in text
    assert "| tv | 50 / 25 (2) | 0 / 0 (2) |" in text
    assert "| tv: Maker#flat-tv, Maker#wall-tv | 50 / 25 (2) | 0 / 0 (2) |" in text


def test_real_homes_stand_apart_from_generated_buildings():
    home = msgspec.structs.replace(RECORD, scene="2_bedroom-s1", success=True, spl=0.5)
    office = msgspec.structs.replace(RECORD, scene="office_3-s0", success=True, spl=0.25)
    failed = [msgspec.structs.replace(r, success=False, spl=0.0, reason="stuck") for r in (home, office)]
    models = defaultdict(list)
    text = page(
        TABLE,
        [TableRow.from_records(ARMS[0], [home, office]), TableRow.from_records(ARMS[1], [home, failed[1]])],
        2,
        models,
        BASIS,
    )
    part = text.partition("## Real homes and generated buildings")[2].partition("##")[0]
    assert "| with | real homes | 1 | 100.0 [100.0, 100.0] | 50.0 [50.0, 50.0] |  |  |" in part
    assert "| with | generated | 1 | 100.0 [100.0, 100.0] | 25.0 [25.0, 25.0] |  |  |" in part
    assert "| without | real homes | 1 | 100.0 [100.0, 100.0] | 50.0 [50.0, 50.0] | +0.0 [+0.0, +0.0] |" in part
    assert "| without | generated | 1 | 0.0 [0.0, 0.0] | 0.0 [0.0, 0.0] | -100.0 [-100.0, -100.0] |" in part


def test_components_are_crossed_the_fewest_changes_first():
    arms = TABLES["components"].arms
    assert len(arms) == 36
    assert arms[0].settings == RunSettings()
    said = {
        (
            arm.settings.fusion_config().objects.association.geometry,
            arm.settings.fusion_config().value.fusion,
            arm.settings.planning.get("strategy", "places"),
        )
        for arm in arms
    }
    assert len(said) == 36
    changes = [
        ("objects" in a.settings.fusion) + ("value" in a.settings.fusion) + len(a.settings.planning) for a in arms
    ]
    assert changes == sorted(changes)
    assert len({arm.levels for arm in arms}) == 36
    assert {len(arm.levels) for arm in arms} == {len(TABLES["components"].factors)}


def test_levels_of_a_factor_are_compared_with_all_else_the_same():
    found, lost = RECORD, msgspec.structs.replace(RECORD, success=False, spl=0.0, reason="out_of_steps")
    arms = {
        levels: Arm(", ".join(levels), RunSettings(), levels=levels)
        for levels in (("big", "red"), ("small", "red"), ("big", "blue"), ("small", "blue"), ("small", "green"))
    }
    table = Table("size", "Size", "About.", tuple(arms.values()), factors=("size", "colour"))
    played = {("big", "red"): lost, ("small", "red"): found, ("small", "blue"): lost, ("small", "green"): found}
    text = page(table, [TableRow.from_records(arms[levels], [r]) for levels, r in played.items()], 1, MODELS, BASIS)
    rows = [line for line in text.splitlines() if line.startswith(("| size: ", "| colour: "))]
    assert rows == [
        "| size: big | 1 | 0.0 [0.0, 0.0] | 0.0 [0.0, 0.0] |  |  |",
        # of three lines only the red one has one of the first level beside it
        "| size: small | 3 | 66.7 [0.0, 100.0] | 33.3 [0.0, 50.0] | +100.0 [+100.0, +100.0] | +50.0 [+50.0, +50.0] |",
        "| colour: red | 2 | 50.0 [0.0, 100.0] | 25.0 [0.0, 50.0] |  |  |",
        "| colour: blue | 1 | 0.0 [0.0, 0.0] | 0.0 [0.0, 0.0] | -100.0 [-100.0, -100.0] | -50.0 [-50.0, -50.0] |",
        "| colour: green | 1 | 100.0 [100.0, 100.0] | 50.0 [50.0, 50.0] | +0.0 [+0.0, +0.0] | +0.0 [+0.0, +0.0] |",
    ]


def test_an_unfinished_arm_says_so():
    assert "| with | 1 (unfinished) |" in page(TABLE, [TableRow.from_records(ARMS[0], [RECORD])], 2, MODELS, BASIS)


def test_an_arm_that_wasnt_played_is_listed_and_nothing_is_compared_with_another():
    text = page(TABLE, [TableRow.from_records(ARMS[1], [RECORD])], 1, MODELS, BASIS)
    assert "| with | 0 | |" in text.replace("  ", " ")
    assert "| without | 1 | 100.0 [100.0, 100.0] | 50.0 [50.0, 50.0] | 60.0 |  |  |  | 100.0 | 100.0 | 10 |" in text
    nothing = page(TABLE, [], 1, MODELS, BASIS)
    assert "| with | 0 |" in nothing
    assert "| without | 0 |" in nothing


def test_differences_say_of_how_many_episodes_they_are():
    lines = [TableRow.from_records(ARMS[0], [RECORD, FAILED]), TableRow.from_records(ARMS[1], [FAILED])]
    assert "| +0.0 [+0.0, +0.0] (of 1) |" in page(TABLE, lines, 2, MODELS, BASIS)
    apart = [TableRow.from_records(ARMS[0], [RECORD]), TableRow.from_records(ARMS[1], [FAILED])]
    assert "| without | 1 (unfinished) | 0.0 [0.0, 0.0] | 0.0 [0.0, 0.0] | 60.0 |  |  |  |" in page(
        TABLE, apart, 2, MODELS, BASIS
    )


def test_the_ratio_is_the_first_lines_over_the_others():
    def line(arm, *spl):
        return TableRow.from_records(
            arm, [msgspec.structs.replace(RECORD, episode_id=str(i), spl=v) for i, v in enumerate(spl)]
        )

    text = page(TABLE, [line(ARMS[0], 0.6, 0.6), line(ARMS[1], 0.2, 0.3)], 2, MODELS, BASIS)
    assert "| 2.40 [2.00, 3.00] |" in text
    assert "| -35.0 [-40.0, -30.0] |  | 100.0 |" in page(
        TABLE, [line(ARMS[0], 0.4, 0.3), line(ARMS[1], 0.0, 0.0)], 2, MODELS, BASIS
    )


@pytest.fixture
def basis(monkeypatch):
    """A dataset of two episodes, and this program."""
    monkeypatch.setattr("surveilnav.benchmark.tables.make.models_of", lambda root, split: MODELS)
    monkeypatch.setattr("surveilnav.benchmark.tables.make.episodes_of", lambda root, split: 2)
    monkeypatch.setattr("surveilnav.benchmark.tables.make.basis_of", lambda root, split: BASIS)
    return BASIS


@pytest.fixture
def played(monkeypatch):
    """Settings of the runs that were begun; each is played to its end."""
    played = []

    def run(root, out, settings, **_):
        played.append(settings)
        return Finished([RECORD, FAILED], [], {}, 0)

    monkeypatch.setattr("surveilnav.benchmark.tables.make.run", run)
    return played


def keep(folder, arm, basis, *records):
    run = Records(folder / "records" / run_id(arm.settings), arm.settings, basis)
    for record in records:
        run.add(record)
    return run


def test_what_is_not_counted_stands_on_the_page(tmp_path, monkeypatch, basis):
    def run(root, out, settings, **_):
        if settings.surveillance:
            return Finished([RECORD], [Broken(scene="flat-s0", episode_id="10", error="Traceback\nOops: bug")], {}, 1)
        return Finished([], [], {"flat-s0": "can't be opened"}, 2)

    monkeypatch.setattr("surveilnav.benchmark.tables.make.run", run)
    made = make(TABLE, tmp_path, tmp_path, workers=1)
    assert not made.complete
    assert made.played == 0
    text = made.page.read_text()
    assert "- with: flat-s0 episode 10 broke: Oops: bug" in text
    assert "- without: flat-s0 could not be played: can't be opened" in text


def test_arms_that_arent_wanted_are_not_played_but_shown_from_the_start(tmp_path, monkeypatch, basis, played):
    keep(tmp_path, ARMS[1], basis, RECORD)
    pages = []
    real = page
    monkeypatch.setattr("surveilnav.benchmark.tables.make.page", lambda *a: pages.append(real(*a)) or pages[-1])
    made = make(TABLE, tmp_path, tmp_path, workers=1, wanted=lambda arm: arm.label == "with")
    assert played == [ARMS[0].settings]
    assert made.complete
    assert made.played == 1
    assert "| without | 1 (unfinished) |" in pages[0], "also while the arm before it is being played"
    assert "| with | 2 |" in made.page.read_text()
    assert "| without | 1 (unfinished) |" in made.page.read_text()


def test_a_page_of_what_is_there_touches_no_run(tmp_path, basis, played):
    run = keep(tmp_path, ARMS[0], basis, RECORD)
    run.add_broken(Broken(scene="flat-s0", episode_id="10", error="Oops: bug"))
    older = keep(tmp_path, ARMS[1], basis._replace(program="older"))
    older.add_broken(Broken(scene="flat-s0", episode_id="9", error="Oops: older"))
    before = {p: p.read_bytes() for p in (tmp_path / "records").rglob("*") if p.is_file()}
    made = make(TABLE, tmp_path, tmp_path, workers=1, wanted=lambda arm: False)
    assert not played
    assert {p: p.read_bytes() for p in (tmp_path / "records").rglob("*") if p.is_file()} == before
    assert "| with | 1 (unfinished) |" in made.page.read_text()
    assert "| without | 0 |" in made.page.read_text()
    assert made.faults == ["with: flat-s0 episode 10 broke: Oops: bug"]


def test_a_page_without_a_line_is_not_written(tmp_path, basis, played):
    (tmp_path / "range.md").write_text("an older page")
    keep(tmp_path, ARMS[0], basis._replace(program="older"), RECORD)
    made = make(TABLE, tmp_path, tmp_path, workers=1, wanted=lambda arm: False)
    assert (made.played, made.page.read_text()) == (0, "an older page")


def test_a_folder_of_another_run_is_said_before_anything_is_played(tmp_path, basis, played):
    """Not after the hours that the arms before it take."""
    keep(tmp_path, ARMS[1], basis._replace(program="older"), RECORD)
    with pytest.raises(ConfigError, match=r"a program that searches otherwise.*delete that folder"):
        make(TABLE, tmp_path, tmp_path, workers=1)
    assert not played
    assert make(TABLE, tmp_path, tmp_path, workers=1, wanted=lambda arm: arm.label == "with").complete


def test_a_folder_of_another_run_is_said_before_another_table_is_played(tmp_path, monkeypatch, basis):
    other = Table("other", "Other", "", (Arm("of an older program", RunSettings(seed=3)),))
    keep(tmp_path, other.arms[0], basis._replace(program="older"), RECORD)
    expect_own_runs([TABLE], tmp_path, tmp_path)
    with pytest.raises(ConfigError, match="a program that searches otherwise"):
        expect_own_runs([TABLE, other], tmp_path, tmp_path)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (RunSettings(split="val"), "has the splits val_mini, not 'val'"),
        (RunSettings(perception="onnx-coco"), "isn't what yolox-nano should be"),
    ],
)
def test_what_an_arm_needs_is_said_before_another_table_is_played(tmp_path, monkeypatch, settings, said):
    """A split that wasn't built, weights that are damaged."""
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(tmp_path))
    (tmp_path / CATALOGUE["yolox-nano"].path).write_bytes(b"damaged")
    index = write(tmp_path / "val_mini" / "val_mini.json.gz", {})
    counts = SplitCounts(scenes=0, floors=0, cameras=0, episodes=1)
    manifest = Manifest(
        version=VERSION, made_by="", rules={}, splits={"val_mini": counts}, sha256={"val_mini/val_mini.json.gz": index}
    )
    write(tmp_path / "dataset.json", manifest)
    expect_own_runs([TABLE], tmp_path, tmp_path)
    with pytest.raises(SurveilNavError, match=said):
        expect_own_runs([TABLE, Table("other", "Other", "", (Arm("one", settings),))], tmp_path, tmp_path)


def test_what_is_played_already_needs_no_weights(tmp_path, monkeypatch, basis):
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(tmp_path))
    (tmp_path / CATALOGUE["deimv2-femto"].path).write_bytes(b"damaged")
    arm = Arm("one", RunSettings(perception="onnx-coco", detectors=["deimv2-femto"]))
    run = keep(tmp_path, arm, basis, RECORD)
    with pytest.raises(SurveilNavError, match="isn't what deimv2-femto should be"):
        expect_own_runs([Table("other", "Other", "", (arm,))], tmp_path, tmp_path)
    run.add(FAILED)
    expect_own_runs([Table("other", "Other", "", (arm,))], tmp_path, tmp_path)


def test_a_dataset_that_isnt_text_is_named(tmp_path):
    (tmp_path / "dataset.json").write_bytes(b'{"version": "\xff"}')
    with pytest.raises(ConfigError, match=r"dataset.json is damaged"):
        make(TABLE, tmp_path, tmp_path, workers=1, wanted=lambda arm: False)
    with pytest.raises(ConfigError, match=r"dataset.json is damaged"):
        expect_own_runs([TABLE], tmp_path, tmp_path)


def test_a_record_that_cannot_be_read_is_named_and_played_again(tmp_path, basis, played):
    run = keep(tmp_path, ARMS[1], basis, RECORD, FAILED)
    run.path.write_text(run.path.read_text().replace("not_seen", "not_sen"))
    expect_own_runs([TABLE], tmp_path, tmp_path)
    assert len(run.done()) == 2, "nothing is forgotten before it is played again"
    made = make(TABLE, tmp_path, tmp_path, workers=1)
    assert made.mended == ["without: flat-s0 episode 10"]
    assert run.all() == [RECORD]
    assert made.page.stat().st_mode & 0o777 == 0o644


def test_a_page_that_cannot_be_written_leaves_the_one_before(tmp_path, monkeypatch, basis, played):
    make(TABLE, tmp_path, tmp_path, workers=1)
    before = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
    assert sorted(before) == ["range.md", "range.png"]

    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(OSError, match="No space"):
        make(TABLE, tmp_path, tmp_path, workers=1)
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()} == before


@pytest.mark.parametrize("over_bytes", [False, True])
def test_the_plot_is_the_same_twice(over_bytes):
    pictures = io.BytesIO(), io.BytesIO()
    table = dataclasses.replace(TABLE, over_bytes=over_bytes)
    for file in pictures:
        plot(table, [TableRow.from_records(ARMS[0], [RECORD, FAILED]), TableRow.from_records(ARMS[1], [FAILED])], file)
    assert pictures[0].getvalue() == pictures[1].getvalue()


def test_the_plot_shows_bytes_if_the_table_asks(monkeypatch):
    shown = []
    real = _over_bytes
    monkeypatch.setattr(
        "surveilnav.benchmark.tables.page._over_bytes", lambda lines, axis: shown.append(axis) or real(lines, axis)
    )
    lines = [TableRow.from_records(ARMS[0], [RECORD, FAILED]), TableRow.from_records(ARMS[1], [FAILED])]
    plot(TABLE, lines, io.BytesIO())
    assert not shown
    plot(dataclasses.replace(TABLE, over_bytes=True), lines, io.BytesIO())
    (axis,) = shown
    assert [bars[0].get_xydata().tolist() for bars in axis.containers] == [[[0.0005, 25.0]], [[0.0, 0.0]]]
    assert [text.get_text() for text in axis.texts] == ["with", "without"]
    assert [t.name for t in TABLES.values() if t.over_bytes] == ["tiers"]


def test_bytes_are_listed_by_tier():
    both = msgspec.structs.replace(RECORD, bytes={"jpeg+depth": 31_731_755, "summaries": 700})
    text = page(
        TABLE, [TableRow.from_records(ARMS[0], [both]), TableRow.from_records(ARMS[1], [FAILED])], 1, MODELS, BASIS
    )
    assert "| path [m] | jpeg+depth [MB] | summaries [MB] | paper, on another dataset: SR / SPL |" in text
    assert "| 4.0 | 31.7 | 0.0007 | 67.4 / 34.5 |" in text
    assert "| 4.0 | 0 | 0 |  |" in text


def test_an_explained_table_says_which_searches_make_the_difference():
    def played(*spl: float) -> list[EpisodeRecord]:
        return [
            msgspec.structs.replace(
                RECORD, episode_id=str(i), spl=s, success=s > 0.0, reason="" if s > 0.0 else "out_of_steps"
            )
            for i, s in enumerate(spl)
        ]

    lines = [
        TableRow.from_records(ARMS[0], played(0.5, 0.0, 0.4, 0.9, 0.3)),
        TableRow.from_records(ARMS[1], played(0.0, 0.6, 0.7, 0.8, 0.3)),
    ]
    table = dataclasses.replace(TABLE, explained=True)
    said = page(table, lines, 5, defaultdict(list), BASIS)
    # (0 - 0.5, 0.6 - 0, 0.7 - 0.4, 0.8 - 0.9, 0) / 5 searches
    assert "| without | +12.0 (1) | -10.0 (1) | +6.0 (1) | -2.0 (1) | +6.0 |" in said
    assert "- Why the first fails where only without succeeds: `out_of_steps` 1." in said
    assert "- Why without fails where only the first succeeds: `out_of_steps` 1." in said
    assert "make the difference" not in page(TABLE, lines, 5, defaultdict(list), BASIS)
