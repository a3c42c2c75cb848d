"""Published runs find their settings again after one was renamed."""

from __future__ import annotations

import json

import pytest

from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.records import Records, facts_of, kept
from surveilnav.benchmark.runner.rename import main, rename
from surveilnav.benchmark.runner.settings import RunSettings, run_id
from surveilnav.errors import ConfigError
from tests.benchmark.runner.test_records import RECORD

BASIS = Basis("dataset", "program")


def published(folder, settings):
    run = Records(folder / run_id(settings), settings, BASIS)
    run.add(RECORD)
    return run.folder


def test_a_nested_setting_gets_another_name_and_place(tmp_path):
    flat = RunSettings(fusion={"objects": {"tau": 1.1, "geometry": "box_iou"}, "value": {"fusion": "latest"}})
    nested = RunSettings(
        fusion={"objects": {"association": {"tau": 1.1, "by": "box_iou"}}, "value": {"fusion": "latest"}}
    )
    old, other = published(tmp_path, flat), published(tmp_path, RunSettings())
    names = {
        "fusion.objects.tau": "fusion.objects.association.tau",
        "fusion.objects.geometry": "fusion.objects.association.by",
    }
    before = (old / "searches.csv").read_bytes()
    assert rename(tmp_path, names) == [(old.name, run_id(nested))]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted([run_id(nested), other.name])
    assert kept(tmp_path / run_id(nested), nested, BASIS).records == [RECORD]
    assert (tmp_path / run_id(nested) / "searches.csv").read_bytes() == before
    assert rename(tmp_path, names) == []


def test_what_a_setting_leaves_empty_goes(tmp_path):
    published(tmp_path, RunSettings(fusion={"objects": {"tau": 1.1}}))
    rename(tmp_path, {"fusion.objects.tau": "fusion.tau"})
    assert kept(tmp_path / run_id(RunSettings(fusion={"tau": 1.1})), RunSettings(fusion={"tau": 1.1}), BASIS)


def test_a_setting_of_the_run_itself(tmp_path, capsys):
    """Its old name is one that runs no longer have."""
    facts = facts_of(RunSettings(delay_steps=5), BASIS)
    facts["settings"]["late_steps"] = facts["settings"].pop("delay_steps")
    folder = tmp_path / "val_mini-00000000"
    folder.mkdir()
    (folder / "settings.json").write_text(json.dumps(facts))
    with pytest.raises(ConfigError, match=r"such settings can't be.*late_steps"):
        rename(tmp_path, {})
    assert main(["late_steps=delay_steps", "--records", str(tmp_path)]) == 0
    assert capsys.readouterr().out == f"val_mini-00000000 -> {run_id(RunSettings(delay_steps=5))}\n"


def test_a_value_is_said_in_another_way(tmp_path):
    off, on = ({"fusion": {"objects": {"tau": 1.1, "tau_mutual": v}}} for v in (2.0, 0.5))
    for settings in (off, on, {}):
        published(tmp_path, RunSettings(**settings))
    arguments = [
        "fusion.objects.tau_mutual=fusion.mutual",
        "--value",
        "fusion.mutual:2.0=null",
        "--records",
        str(tmp_path),
    ]
    assert main(arguments) == 0
    for mutual in (None, 0.5):
        settings = RunSettings(fusion={"objects": {"tau": 1.1}, "mutual": mutual})
        assert kept(tmp_path / run_id(settings), settings, BASIS).records == [RECORD]
    assert len(list(tmp_path.iterdir())) == 3


@pytest.mark.parametrize("arguments", [["fusion.tau"], ["--value", "tau=3"], ["--value", "tau:3=x"]])
def test_what_cant_be_read_is_said(tmp_path, arguments, capsys):
    with pytest.raises(SystemExit):
        main([*arguments, "--records", str(tmp_path)])
    assert "error:" in capsys.readouterr().err


def test_two_runs_arent_made_one(tmp_path):
    folders = [published(tmp_path, RunSettings(planning={name: 1})) for name in ("a", "b")]
    with pytest.raises(ConfigError, match="two runs come to"):
        rename(tmp_path, {"planning.a": "planning.b"})
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(f.name for f in folders)


def test_names_may_be_swapped(tmp_path):
    folders = [published(tmp_path, RunSettings(planning={name: 1})) for name in ("a", "b")]
    moved = rename(tmp_path, {"planning.a": "planning.c", "planning.b": "planning.a", "planning.c": "planning.b"})
    assert moved == sorted([(folders[0].name, folders[1].name), (folders[1].name, folders[0].name)])
    for name in ("a", "b"):
        settings = RunSettings(planning={name: 1})
        assert kept(tmp_path / run_id(settings), settings, BASIS).records == [RECORD]
