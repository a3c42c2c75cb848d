"""Records survive what happens to files; runs can't be mixed."""

from __future__ import annotations

import json
import sqlite3
import subprocess
import sys
import zlib
from pathlib import Path

import msgspec
import numpy as np
import pytest

from benchmark.runner.basis import Basis, hash_of, meaning, program_hash, program_parts
from benchmark.runner.records import Broken, EpisodeRecord, Records, _record_of, kept, read
from benchmark.runner.settings import RunSettings
from benchmark.runner.summary import interval, paired, pairs_of, summarise
from surveilnav.errors import ConfigError

RECORD = EpisodeRecord(
    scene="flat-s0", episode_id="2", category="tv", success=True, spl=0.5, soft_spl=0.6, steps=10, path_m=4.0,
    shortest_path_m=2.0, distance_m=0.05, reason="", message="found", seen=True, floors=["0"], invoked=["c0-1"],
    bytes={"jpeg+depth": 1000}, path=[(-700, 310), (-450, 310), (-450, 60)], seconds=1.0,
)  # fmt: skip
FAILED = msgspec.structs.replace(RECORD, episode_id="10", success=False, spl=0.0, reason="not_seen", bytes={})


BASIS = Basis("hash", "program")


def test_kept_and_read_back_in_the_datasets_order(tmp_path):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(FAILED)
    records.add(RECORD)
    again = Records(tmp_path, RunSettings(), BASIS)
    assert again.all() == [RECORD, FAILED]  # 2 before 10
    nowhere = msgspec.structs.replace(RECORD, path=[])
    again.add(nowhere)
    assert again.all() == [nowhere, FAILED]
    assert again.done() == {RECORD.key, FAILED.key}


def test_anybody_can_read_a_run_without_its_program_and_dataset(tmp_path):
    with pytest.raises(ConfigError, match="holds no run"):
        read(tmp_path)
    records = Records(tmp_path, RunSettings(max_steps=50), Basis("any", "older"))
    assert read(tmp_path) == []
    records.add(RECORD)
    assert read(tmp_path) == [RECORD]
    with sqlite3.connect(records.path) as db:
        db.execute("UPDATE run SET facts = ?", [json.dumps({"version": 2})])
    with pytest.raises(ConfigError, match="version 2"):
        read(tmp_path)


def test_a_broken_episode_is_kept_apart_until_it_is_played(tmp_path):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add_broken(Broken(scene="flat-s0", episode_id="2", error="Traceback"))
    assert records.all() == []
    assert records.done() == set()
    assert [b.episode_id for b in records.broken()] == ["2"]
    records.add(RECORD)
    assert records.broken() == []


@pytest.mark.parametrize(
    ("settings", "basis", "said"),
    [
        (RunSettings(max_steps=50), BASIS, "max_steps 500, asked 50"),
        (RunSettings(surveillance=False), BASIS, "surveillance True, asked False"),
        (RunSettings(), Basis("other", "program"), "another dataset"),
        (RunSettings(), Basis("hash", "newer"), "another version of the program"),
    ],
)
def test_runs_cant_be_mixed(tmp_path, settings, basis, said):
    Records(tmp_path, RunSettings(), BASIS).add(RECORD)
    with pytest.raises(ConfigError, match=said):
        Records(tmp_path, settings, basis)


def test_a_folder_without_an_episode_takes_any_run(tmp_path):
    wrong = Records(tmp_path, RunSettings(max_steps=50), BASIS)
    wrong.add_broken(Broken(scene="flat-s0", episode_id="2", error="Traceback"))
    records = Records(tmp_path, RunSettings(), BASIS)
    assert records.broken() == []
    records.add(RECORD)
    with pytest.raises(ConfigError, match="another run"):
        Records(tmp_path, RunSettings(max_steps=50), BASIS)


def test_a_folder_that_cant_be_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="can't be made a folder for a run"):
        Records(tmp_path / "file", RunSettings(), BASIS)


def test_a_damaged_file_is_named(tmp_path):
    Records(tmp_path, RunSettings(), BASIS).add(RECORD)
    path = tmp_path / "episodes.sqlite"
    path.write_bytes(b"not a database" * 400)
    with pytest.raises(ConfigError, match=r"damaged.*move it away"):
        Records(tmp_path, RunSettings(), BASIS)


@pytest.mark.parametrize(
    "blob", [b'{"scene": 3', zlib.compress(b'{"scene": 3'), zlib.compress(b'{"scene": "\xff"}'), "text"]
)
def test_a_damaged_record_is_named(tmp_path, blob):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    with sqlite3.connect(records.path) as db:
        db.execute("UPDATE episodes SET record = ?", [blob])
    records.add(FAILED)
    with pytest.raises(ConfigError, match=r"can't be read.*plays that episode anew"):
        records.all()
    assert records.mend() == [RECORD.key]
    assert records.mend() == []
    assert records.all() == [FAILED]


@pytest.mark.parametrize(
    "damage",
    ["scene = NULL", "scene = CAST(x'ff' AS TEXT)", "episode_id = '7'", "success = 0", "spl = .6", "reason = 'stuck'"],
)
def test_a_row_that_contradicts_itself_is_named_and_played_again(tmp_path, damage):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    with sqlite3.connect(records.path) as db:
        db.execute(f"UPDATE episodes SET {damage}")
    records.add(FAILED)
    with pytest.raises(ConfigError, match=r"can't be read.*plays that episode anew"):
        read(tmp_path)
    assert len(records.mend()) == 1
    assert records.mend() == []
    assert records.done() == {FAILED.key}
    records.add(RECORD)
    assert records.all() == [RECORD, FAILED]


@pytest.mark.parametrize("where", ["find", "rfind"])
def test_a_key_that_was_damaged_on_the_disk_is_neither_lost_nor_counted_twice(tmp_path, where):
    """A key stands in the file twice: with its record, and in the index."""
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    records.add(FAILED)
    data = bytearray(records.path.read_bytes())
    at = getattr(data, where)(b"flat-s02")
    assert data.count(b"flat-s02") == 2
    data[at + 7] = ord("7")
    records.path.write_bytes(data)
    mended = records.mend()
    assert mended in ([], [("flat-s0", "7")])  # of the index alone, nothing is lost
    assert records.mend() == []
    assert records.done() == {r.key for r in records.all()} == ({FAILED.key} if mended else {RECORD.key, FAILED.key})
    records.add(RECORD)
    assert records.all() == [RECORD, FAILED]


def test_what_is_mended_is_not_lost_when_the_disk_is_full(tmp_path, monkeypatch):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    records.add(FAILED)
    with sqlite3.connect(records.path) as db:
        db.execute("UPDATE episodes SET success = 0 WHERE episode_id = ?", [RECORD.episode_id])

    class Full(sqlite3.Connection):
        def executemany(self, *_):
            raise sqlite3.OperationalError("database or disk is full")

    real = sqlite3.connect
    monkeypatch.setattr(sqlite3, "connect", lambda *a, **k: real(*a, **k, factory=Full))
    with pytest.raises(ConfigError, match="is the disk full"):
        records.mend()
    monkeypatch.undo()
    assert records.done() == {RECORD.key, FAILED.key}
    assert records.mend() == [RECORD.key]
    assert records.all() == [FAILED]


def test_nobody_writes_while_it_is_mended(tmp_path, monkeypatch):
    """What another process adds then isn't dropped with the old table."""
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    with sqlite3.connect(records.path) as db:
        db.execute("UPDATE episodes SET success = 0")
    monkeypatch.setattr("benchmark.runner.records._BUSY_S", 0.1)
    real = _record_of

    def meanwhile(row):
        with pytest.raises(ConfigError, match="locked"):
            records.add(FAILED)
        return real(row)

    monkeypatch.setattr("benchmark.runner.records._record_of", meanwhile)
    assert records.mend() == [RECORD.key]


def test_another_run_whose_settings_cant_be_read_is_refused(tmp_path):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    with sqlite3.connect(records.path) as db:
        db.execute("UPDATE run SET facts = ?", [json.dumps({"version": 3, **BASIS._asdict()})])
    with pytest.raises(ConfigError, match=r"another run .*settings aren't said"):
        Records(tmp_path, RunSettings(), BASIS)


@pytest.mark.parametrize("facts", ["", "{", "[]", b"\xff"])
def test_a_file_that_doesnt_say_of_which_run_it_is_is_named(tmp_path, facts):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    with sqlite3.connect(records.path) as db:
        db.execute("UPDATE run SET facts = ?", [facts])
    for use in (
        lambda: Records(tmp_path, RunSettings(), BASIS),
        lambda: read(tmp_path),
        lambda: kept(tmp_path, RunSettings(), BASIS),
    ):
        with pytest.raises(ConfigError, match=r"doesn't say of which run.*move it away"):
            use()


def test_a_full_disk_is_named(tmp_path, monkeypatch):
    records = Records(tmp_path, RunSettings(), BASIS)
    real, scattered = sqlite3.connect, [(i * i % 65_537, i * i * i % 65_539) for i in range(50_000)]

    def full(*arguments, **options):
        db = real(*arguments, **options)
        db.execute("PRAGMA max_page_count = 1")  # SQLite's own word for it: "database or disk is full"
        return db

    monkeypatch.setattr(sqlite3, "connect", full)
    with pytest.raises(ConfigError, match="full"):
        records.add(msgspec.structs.replace(RECORD, path=scattered))
    monkeypatch.undo()
    assert all(r.scene == "flat-s0" for r in records.all())  # what was kept can be read


def test_numbers_and_their_intervals():
    s = summarise([RECORD, FAILED])
    assert (s.sr.mean, s.spl.mean, s.episodes, s.reasons) == (50.0, 25.0, 2, {"not_seen": 1})
    assert s.bytes == {"jpeg+depth": 500.0}
    many, scenes = [100.0] * 60 + [0.0] * 40, [f"flat-s{i:02}" for i in range(100)]
    i = interval(many, scenes)
    assert i == interval(many, scenes)  # the same draws
    assert i.mean == 60.0
    assert 48 < i.low < 53 < 67 < i.high < 72  # +-1.96 * sqrt(.6 * .4 / 100)
    assert interval(many, ["flat-s0"] * 100) == i  # of one scene: its searches
    with pytest.raises(ValueError, match="no episode"):
        summarise([])


def test_scenes_are_drawn_with_all_their_searches():
    rng = np.random.default_rng(7)
    by_scene = {f"flat-s{i}": rng.normal(rng.normal(50, 20), 5, rng.integers(2, 30)) for i in range(12)}
    draws = []
    for _ in range(4000):  # word by word
        some = np.concatenate([by_scene[f"flat-s{i}"] for i in rng.integers(12, size=12)])
        draws.append(some.mean())
    found = interval(np.concatenate(list(by_scene.values())), [s for s, v in by_scene.items() for _ in v])
    assert (found.low, found.high) == pytest.approx(np.percentile(draws, [2.5, 97.5]), abs=0.8)
    assert found.high - found.low > 15


def test_success_farther_off_and_failures_that_were_seen():
    def stopped(distance_m, **other):
        facts = {"episode_id": "10", "success": False, "spl": 0.0, "distance_m": distance_m, **other}
        return msgspec.structs.replace(RECORD, **facts)

    short = stopped(0.15, reason="stopped_short")
    s = summarise([
        RECORD, short, stopped(0.9, reason="stopped_short"), stopped(1.1, reason="false_positive", seen=False),
        stopped(0.1, reason="out_of_steps"), stopped(None, reason="wrong_floor", seen=False),
    ])  # fmt: skip
    assert s.sr_within == pytest.approx({0.2: 100 * 2 / 6, 1.0: 50.0})
    assert s.reasons == {"false_positive": 1, "out_of_steps": 1, "stopped_short": 2, "wrong_floor": 1}
    assert s.seen == {"out_of_steps": 1, "stopped_short": 2}


def test_paired_differences_use_common_episodes():
    line = [RECORD, msgspec.structs.replace(FAILED, success=True, spl=0.4)]
    found = paired(pairs_of(line, [FAILED, msgspec.structs.replace(RECORD, episode_id="99")]))
    assert (found.pairs, found.sr.mean, round(found.spl.mean, 6)) == (1, 100.0, 40.0)
    assert paired(pairs_of([RECORD], [FAILED])) is None


def test_a_ratio_is_that_of_resampled_pairs():
    rng = np.random.default_rng(5)
    spl = rng.uniform(0.1, 1.0, (40, 2))
    line, first = (
        [msgspec.structs.replace(RECORD, scene=f"flat-s{i}", spl=float(v)) for i, v in enumerate(column)]
        for column in spl.T
    )
    found = paired(pairs_of(line, first)).ratio
    draws = []
    for _ in range(4000):  # Efron's bootstrap, word by word
        some = [spl[i] for i in rng.integers(40, size=40)]
        draws.append(sum(b for _, b in some) / sum(a for a, _ in some))
    assert found.mean == pytest.approx(spl[:, 1].sum() / spl[:, 0].sum())
    assert (found.low, found.high) == pytest.approx(np.percentile(draws, [2.5, 97.5]), abs=0.02)
    assert paired(pairs_of([msgspec.structs.replace(r, spl=0.0) for r in line], first)).ratio is None


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (RunSettings(policy="best"), "there is no policy 'best'"),
        (RunSettings(perception="auto"), "perception is one of"),
        (RunSettings(max_steps=0), "1 to 5000 steps"),
        (RunSettings(fusion={"objects": {"geometry": "sphere"}}), "geometry"),
        (RunSettings(fusion={"clouds": {}}), "clouds"),
        (RunSettings(planning={"speed": 3}), "no setting 'speed'"),
        (RunSettings(planning={"strategy": "best"}), "strategy"),
        (RunSettings(detectors=["yolo-huge"]), "yolox-nano, .*got 'yolo-huge'"),
        (RunSettings(delay_steps=-1), "0 or more"),
    ],
)
def test_settings_that_cant_be_are_named(settings, said):
    with pytest.raises(ConfigError, match=said):
        settings.check()


def test_one_setting_is_changed_and_the_others_stay():
    changed = RunSettings(fusion={"objects": {"association": {"geometry": "box_iou"}}}).fusion_config()
    plain = RunSettings().fusion_config()
    changed_association, association = changed.objects.association, plain.objects.association
    assert changed_association.geometry == "box_iou"
    assert changed_association.model_copy(update={"geometry": association.geometry}) == association
    assert changed.objects.model_copy(update={"association": association}) == plain.objects
    assert changed.map == plain.map


@pytest.mark.parametrize(
    ("changed", "same"),
    [
        ('def f(x):\n    """Says more."""\n    # and a comment\n    return (x +\n            1)\n', True),
        ("def f(x):\n    return x + 2\n", False),
        ('def f(x):\n    return "x" + 1\n', False),
    ],
)
def test_only_what_changes_numbers_makes_another_program(changed, same):
    assert (meaning('def f(x):\n    """Says."""\n    return x + 1\n') == meaning(changed)) == same


def test_all_versions_of_python_see_the_same_program():
    """Python 3.12 prints fields of definitions that earlier ones haven't."""
    assert "type_params" not in meaning("class C:\n    def f(self): pass\nasync def g(): pass\n")


@pytest.mark.parametrize(
    ("file", "text", "same"),
    [
        ("core/a.py", "X = 1  # one\n", True),
        ("core/a.py", "X = 2\n", False),
        ("core/data/t.json", "[2]", False),
        ("core/new.py", "", False),
        ("core/notes.md", "other", True),
        ("other/a.py", "X = 2\n", True),
    ],
)
def test_code_and_tables_make_the_program(tmp_path, file, text, same):
    files = {"core/a.py": "X = 1\n", "core/data/t.json": "[1]", "core/notes.md": "", "one.py": "", "other/a.py": ""}
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    before = hash_of({tmp_path: ("core", "one.py")})
    (tmp_path / file).write_text(text)
    assert (hash_of({tmp_path: ("core", "one.py")}) == before) == same


#: What a search imports that doesn't decide how it goes: packages, keeping, counting, the bus.
_NOT_THE_PROGRAM = {
    "benchmark", "benchmark.dataset", "benchmark.dataset.integrity", "benchmark.dataset.splits", "benchmark.runner",
    "benchmark.runner.basis", "benchmark.runner.records", "services", "services.camera_node", "services.fusion",
    "services.planner", "services.robot_node", "surveilnav", "surveilnav.config", "surveilnav.contract", "surveilnav.errors",
    "surveilnav.bus", "surveilnav.bus.logs", "surveilnav.bus.node", "surveilnav.bus.settings",
    "surveilnav.bus.traffic",
}  # fmt: skip


def test_whatever_plays_a_search_is_part_of_the_program():
    code = "import sys, benchmark.runner.play; [print(n, getattr(m, '__file__', '')) for n, m in sys.modules.items()]"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    parts = {root / part for root, parts in program_parts().items() for part in parts}
    loaded = dict(line.split(" ", 1) for line in said.splitlines())
    loaded = {n: file for n, file in loaded.items() if n.split(".")[0] in ("benchmark", "services", "surveilnav")}
    others = {name for name, file in loaded.items() if not parts & {Path(file), *Path(file).parents}}
    assert len(loaded) > 60
    assert others <= _NOT_THE_PROGRAM


def test_all_parts_of_the_program_are_there():
    assert all((root / part).exists() for root, parts in program_parts().items() for part in parts)
    assert len(program_hash()) == 64
