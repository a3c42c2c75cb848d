"""Records survive what happens to files; runs can't be mixed."""

from __future__ import annotations

import json
import os
import threading
import zlib

import msgspec
import numpy as np
import pytest

from surveilnav.benchmark import journal
from surveilnav.benchmark.play.approach import Approach
from surveilnav.benchmark.runner import records as module
from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.records import Broken, Records, read, stored_run
from surveilnav.benchmark.runner.row import HEADER, EpisodeRecord, record_of_row, row_of
from surveilnav.benchmark.runner.settings import RunSettings, run_id
from surveilnav.benchmark.runner.summary import interval, paired, pairs_of, summarise
from surveilnav.errors import ConfigError

RECORD = EpisodeRecord(
    scene="flat-s0",
    episode_id="2",
    category="tv",
    success=True,
    spl=0.5,
    soft_spl=0.6,
    steps=10,
    path_m=4.0,
    shortest_path_m=2.0,
    distance_m=0.05,
    reason="",
    seen=True,
    bytes={"jpeg+depth": 1000},
    seconds=1.0,
    approach=Approach(
        closest_m=0.05, first_near_path_m=0.0, first_near_left_m=2.0, last_near_path_m=3.0, last_near_left_m=0.9
    ),
    camera_chance=0.25,
)
FAILED = msgspec.structs.replace(
    RECORD,
    episode_id="10",
    success=False,
    spl=0.0,
    reason="not_seen",
    bytes={},
    approach=Approach(closest_m=3.5),
    camera_chance=None,
)
#: What an older program kept of both.
OLD = {"approach": None, "camera_chance": None}
OLD_TABLE = """\
scene,episode_id,category,success,spl,soft_spl,steps,path_m,shortest_path_m,distance_m,reason,seen,frame_bytes,summary_bytes,seconds,crc32
flat-s0,2,tv,1,0.5,0.6,10,4.0,2.0,0.05,,1,1000,,1.0,CRC2
flat-s0,10,tv,0,0.0,0.6,10,4.0,2.0,0.05,not_seen,1,,,1.0,CRC10
"""


BASIS = Basis("hash", "program")


def edit(records, old, new):
    """Changes the table's file; ``old`` stands in it once."""
    data = records.path.read_bytes()
    assert data.count(old) == 1
    records.path.write_bytes(data.replace(old, new))


def test_kept_and_read_back_in_the_datasets_order(tmp_path):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(FAILED)
    records.add(RECORD)
    again = Records(tmp_path, RunSettings(), BASIS)
    assert again.all() == [RECORD, FAILED]  # 2 before 10
    longer = msgspec.structs.replace(RECORD, steps=11, distance_m=None)
    again.add(longer)
    assert again.all() == [longer, FAILED]  # of two rows of a search the last counts
    assert again.done() == {RECORD.key, FAILED.key}


def test_a_finished_run_makes_the_same_file_in_whatever_order_it_was_played(tmp_path):
    files = []
    for name, played in (("a", [FAILED, RECORD]), ("b", [RECORD, FAILED, RECORD])):
        records = Records(tmp_path / name, RunSettings(), BASIS)
        for record in played:
            records.add(record)
        records.sort()
        assert sorted(p.name for p in records.folder.iterdir()) == ["searches.csv", "settings.json"]
        files.append({p.name: p.read_bytes() for p in records.folder.iterdir()})
    assert files[0] == files[1]
    assert files[0]["searches.csv"].decode().splitlines()[0] == HEADER


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"distance_m": None},
        {"bytes": {}},
        {"bytes": {"jpeg+depth": 0, "summaries": 7}},
        {"reason": "stuck", "success": False},
        {"scene": 'own, "old" hôtel-s0'},
        {"spl": 0.123457},
        {"path_m": 1234.567891},
        {"seen": False},
        {"approach": Approach()},
        {"approach": Approach(closest_m=2.5, first_near_path_m=1.25, first_near_left_m=2.999)},
        {"camera_chance": 0.0},
        {"spl": 1e-6},
    ],
)
def test_a_row_says_what_the_record_says(change):
    record = msgspec.structs.replace(RECORD, **change)
    assert record_of_row(row_of(record)) == record
    assert len(row_of(record).split("\n")) == 1


def test_a_tier_without_a_column_is_refused():
    with pytest.raises(ValueError, match=r"jpeg\+depth, summaries, not for 'objects'"):
        row_of(msgspec.structs.replace(RECORD, bytes={"objects": 1}))


def test_a_thousand_searches_are_small():
    long = msgspec.structs.replace(
        FAILED,
        scene="3_bedroom_mezzanine-s0",
        category="potted plant",
        reason="seen_and_rejected",
        spl=1 / 7,
        soft_spl=1 / 7,
        steps=499,
        path_m=1000 / 7,
        shortest_path_m=100 / 7,
        distance_m=100 / 7,
        seconds=1000 / 7,
        bytes={"jpeg+depth": 31_731_755, "summaries": 1234},
    )
    near = Approach(**dict.fromkeys(Approach.__struct_fields__, 1000 / 7))
    long = msgspec.structs.replace(long, approach=near, camera_chance=1 / 7)
    assert 1000 * (len(row_of(long)) + 1) <= 200_000


def old_run(folder):
    """A run that an older program played: the same but for the columns that it didn't have."""
    lines = OLD_TABLE.splitlines()
    rows = [row.rpartition(",")[0] for row in lines[1:]]
    folder.mkdir(exist_ok=True)
    folder.joinpath("searches.csv").write_text(
        "".join(f"{line}\n" for line in (lines[0], *(f"{r},{zlib.crc32(r.encode()):08x}" for r in rows)))
    )
    facts = module.facts_of(RunSettings(), BASIS) | {"version": 4}
    facts["settings"].pop("camera_perception")
    module.write_facts(folder, facts)
    return folder


def test_a_table_of_the_version_before_is_still_read(tmp_path):
    folder = old_run(tmp_path)
    records = [msgspec.structs.replace(r, **OLD) for r in (RECORD, FAILED)]
    assert read(folder) == records
    assert stored_run(folder, RunSettings(), BASIS).records == records
    assert stored_run(folder, RunSettings(seed=1), BASIS) is None
    with pytest.raises(ValueError, match="older table"):
        row_of(records[0])


def test_no_run_goes_on_in_a_table_of_the_version_before(tmp_path):
    """Half of its searches couldn't be explained."""
    folder = old_run(tmp_path)
    before = (folder / "searches.csv").read_bytes()
    with pytest.raises(ConfigError, match=r"of version 4\): take another --out"):
        Records(folder, RunSettings(), BASIS)
    assert (folder / "searches.csv").read_bytes() == before
    (folder / "searches.csv").write_text(OLD_TABLE.splitlines()[0] + "\n")  # nothing was played
    records = Records(folder, RunSettings(), BASIS)
    records.add(RECORD)
    assert records.path.read_text().splitlines() == [HEADER, row_of(RECORD)]


def test_a_row_that_was_torn_by_a_kill_is_neither_read_nor_in_the_way(tmp_path):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    with records.path.open("a") as file:
        file.write(row_of(FAILED)[:40])
    assert records.all() == [RECORD]
    assert records.done() == {RECORD.key}
    assert records.forget_damaged() == []
    records.add(FAILED)
    assert Records(tmp_path, RunSettings(), BASIS).all() == [RECORD, FAILED]
    assert len(records.path.read_text().splitlines()) == 3


def test_anybody_can_read_a_run_without_its_program_and_dataset(tmp_path):
    with pytest.raises(ConfigError, match="holds no run"):
        read(tmp_path)
    records = Records(tmp_path, RunSettings(max_steps=50), Basis("any", "older"))
    assert read(tmp_path) == []
    records.add(RECORD)
    assert read(tmp_path) == [RECORD]
    (tmp_path / "settings.json").write_text(json.dumps({"version": 2}))
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
        (RunSettings(), Basis("hash", "newer"), "a program that searches otherwise"),
    ],
)
def test_runs_cant_be_mixed(tmp_path, settings, basis, said):
    Records(tmp_path, RunSettings(), BASIS).add(RECORD)
    with pytest.raises(ConfigError, match=said):
        Records(tmp_path, settings, basis)


def test_searches_with_other_weights_of_one_name_arent_mixed(tmp_path, monkeypatch):
    settings = RunSettings(perception="compact")
    Records(tmp_path, settings, BASIS).add(RECORD)
    Records(tmp_path, settings, BASIS)
    monkeypatch.setattr(module.models, "model_id", lambda name, path: f"{name}@deadbeef")
    with pytest.raises(ConfigError, match=r"seen with compact@[0-9a-f]{8}, now there is compact@deadbeef"):
        Records(tmp_path, settings, BASIS)


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


@pytest.mark.parametrize("text", [b"not a table" * 400, b"not a table\n" * 400, HEADER.encode(), b"", b"\xff\n"])
def test_a_damaged_file_is_named(tmp_path, text):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    records.path.write_bytes(text)
    with pytest.raises(ConfigError, match=r"damaged.*move it away"):
        Records(tmp_path, RunSettings(), BASIS).all()
    assert records.path.read_bytes() == text


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"flat-s0,2", b"flat-s0,3"),
        (b"flat-s0,2", b"flat-s7,2"),
        (b",2,tv", b",\xff,tv"),
        (b",tv,1,", b",tv,0,"),
        (b",0.5,", b",0.6,"),
        (b",0.5,", b",,"),
        (b"flat-s0,2,tv,1,0.5,", b"flat-s0,2,tv,1,"),
        (b"flat-s0,2,tv", b""),
    ],
)
def test_a_row_that_was_damaged_is_named_and_played_again(tmp_path, old, new):
    """Also where it still reads like a row: a checksum ends it."""
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    edit(records, old, new)
    records.add(FAILED)
    with pytest.raises(ConfigError, match=r"can't be read.*plays that search anew"):
        read(tmp_path)
    assert len(records.forget_damaged()) == 1
    assert records.forget_damaged() == []
    assert records.done() == {FAILED.key}
    records.add(RECORD)
    assert records.all() == [RECORD, FAILED]


def test_what_is_mended_is_not_lost_when_the_disk_is_full(tmp_path, monkeypatch):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    records.add(FAILED)
    edit(records, b"flat-s0,2,tv,1", b"flat-s0,2,tv,0")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(ConfigError, match="is the disk full"):
        records.forget_damaged()
    monkeypatch.undo()
    assert records.done() == {RECORD.key, FAILED.key}
    assert records.forget_damaged() == [RECORD.key]
    assert records.all() == [FAILED]


def test_nobody_writes_while_it_is_mended(tmp_path, monkeypatch):
    """What another process adds then isn't dropped with the old table."""
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    edit(records, b",tv,1,", b",tv,0,")
    real, adding = record_of_row, threading.Thread(target=records.add, args=[FAILED])

    def meanwhile(row):
        monkeypatch.undo()
        adding.start()
        adding.join(0.3)
        assert adding.is_alive(), "it waits"
        return real(row)

    monkeypatch.setattr(module, "record_of_row", meanwhile)
    assert records.forget_damaged() == [RECORD.key]
    adding.join(10.0)
    assert records.all() == [FAILED]


def test_several_processes_keep_all_their_rows(tmp_path):
    records = Records(tmp_path, RunSettings(), BASIS)

    def add(first):
        for n in range(first, first + 50):
            Records(tmp_path, RunSettings(), BASIS).add(msgspec.structs.replace(RECORD, episode_id=str(n)))

    threads = [threading.Thread(target=add, args=[50 * n]) for n in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [r.episode_id for r in records.all()] == [str(n) for n in range(200)]


def test_another_run_whose_settings_cant_be_read_is_refused(tmp_path):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    facts = {"version": module.VERSION, **BASIS._asdict()}
    for settings, said in (
        ({}, "settings aren't said"),
        ({"settings": {"pace": 3}}, "'pace' that there isn't"),
    ):
        (tmp_path / "settings.json").write_text(json.dumps(facts | settings))
        with pytest.raises(ConfigError, match=rf"another run .*{said}"):
            Records(tmp_path, RunSettings(), BASIS)
        assert stored_run(tmp_path, RunSettings(), BASIS) is None


def test_a_run_from_before_a_setting_was_added_has_its_default(tmp_path):
    Records(tmp_path, RunSettings(), BASIS).add(RECORD)
    facts = module.facts_of(RunSettings(), BASIS)
    del facts["settings"]["harder"]
    (tmp_path / "settings.json").write_text(json.dumps(facts))
    assert Records(tmp_path, RunSettings(), BASIS).all() == [RECORD]
    assert stored_run(tmp_path, RunSettings(harder=1.0), BASIS) is None


@pytest.mark.parametrize("facts", [b"", b"{", b"[]", b"\xff"])
def test_a_file_that_doesnt_say_of_which_run_it_is_is_named(tmp_path, facts):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)
    (tmp_path / "settings.json").write_bytes(facts)
    for use in (
        lambda: Records(tmp_path, RunSettings(), BASIS),
        lambda: read(tmp_path),
        lambda: stored_run(tmp_path, RunSettings(), BASIS),
    ):
        with pytest.raises(ConfigError, match=r"doesn't say of which run.*move it away"):
            use()


def test_searches_without_settings_are_another_run(tmp_path):
    Records(tmp_path, RunSettings(), BASIS).add(RECORD)
    (tmp_path / "settings.json").unlink()
    with pytest.raises(ConfigError, match="another run"):
        Records(tmp_path, RunSettings(), BASIS)
    assert stored_run(tmp_path, RunSettings(), BASIS) is None


def test_a_full_disk_is_named_and_what_was_kept_can_be_read(tmp_path, monkeypatch):
    records = Records(tmp_path, RunSettings(), BASIS)
    records.add(RECORD)

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(ConfigError, match="is the disk full"):
        records.add(FAILED)
    monkeypatch.undo()
    assert RECORD in records.all()


def test_lines_are_whole_or_not_there(tmp_path):
    path = tmp_path / "journal"
    journal.append(path, "one")
    path.write_bytes(path.read_bytes() + b"tw")
    assert journal.lines(path) == ["one"]
    journal.append(path, "three")
    assert path.read_bytes() == b"one\nthree\n"
    path.write_bytes(b"torn from the first on")
    journal.append(path, "four")
    assert journal.lines(path) == ["four"]


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
    s = summarise(
        [
            RECORD,
            short,
            stopped(0.9, reason="stopped_short"),
            stopped(1.1, reason="false_positive", seen=False),
            stopped(0.1, reason="out_of_steps"),
            stopped(None, reason="wrong_floor", seen=False),
        ]
    )
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
        (RunSettings(fusion={"objects": {"association": {"geometry": "sphere"}}}), "geometry"),
        (RunSettings(fusion={"clouds": {}}), "clouds"),
        (RunSettings(planning={"speed": 3}), "speed\n.*Extra inputs are not permitted"),
        (RunSettings(planner="warp"), "planner is one of fmm, sp, got 'warp'"),
        (RunSettings(views="all"), "views is one of panoramic, half, got 'all'"),
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


def test_a_runs_name_is_of_its_settings_alone():
    names = [
        run_id(RunSettings(**s)) for s in ({}, {"seed": 1}, {"planning": {"strategy": "greedy"}}, {"split": "val"})
    ]
    assert len(set(names)) == 4
    assert all(len(name) <= len("val_mini-") + 8 for name in names)
    maps = {"objects": {"tau": 1.1, "geometry": "box_iou"}, "value": {"fusion": "latest"}}
    turned = {"value": {"fusion": "latest"}, "objects": {"geometry": "box_iou", "tau": 1.1}}
    assert run_id(RunSettings(fusion=maps)) == run_id(RunSettings(fusion=turned))
    assert run_id(RunSettings(split="a/b")).startswith("a_b-")
    assert run_id(RunSettings()) == "val_mini-44136fa3", "published runs are found by it"
