"""``surveilnav dataset`` and ``surveilnav bench`` as a user types them."""

from __future__ import annotations

import errno
import json
import subprocess
import sys
import time

import msgspec
import pytest
from typer.testing import CliRunner

from surveilnav.benchmark.dataset.make import make
from surveilnav.benchmark.dataset.splits import SceneSpec, SplitSpec
from surveilnav.benchmark.runner.records import read
from surveilnav.benchmark.tables.make import Made
from surveilnav.cli.bench import app
from surveilnav.cli.main import main


def surveilnav(*arguments, timeout_s=240):
    command = [sys.executable, "-m", "surveilnav.cli.main", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=timeout_s)


@pytest.fixture
def typed(monkeypatch, capsys):
    """``typed(*arguments)``: what the console script ends with and says, in this process; for mistakes, which end it soon."""
    monkeypatch.setattr("surveilnav.cli.main.signal.signal", lambda *_: None)

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["surveilnav", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return run


@pytest.fixture(scope="module")
def root(made_once):
    split = SplitSpec("val_mini", (SceneSpec("parametric_flat", 0, "all"),), 6)
    return made_once("cli-dataset", lambda root: make(root, [split], workers=1))


def test_a_run_says_its_numbers_as_one_object(root, tmp_path):
    out = ("--root", root, "--out", tmp_path / "run", "--perception", "oracle", "--max-steps", 25, "--workers", 1)
    first = surveilnav("bench", "run", *out, "--json")
    assert first.returncode == 0, first.stderr
    said = json.loads(first.stdout)
    assert {"sr", "spl", "soft_spl", "episodes", "seconds", "traffic"} <= set(said)
    assert said["episodes"] == 6
    assert 0.0 <= said["spl"] <= said["sr"] <= 100.0
    again = json.loads(surveilnav("bench", "run", *out, "--json").stdout)  # nothing is missing: nothing is played
    assert {k: v for k, v in again.items() if k != "seconds"} == {k: v for k, v in said.items() if k != "seconds"}


@pytest.mark.parametrize(
    ("option", "value", "said"),
    [
        ("--planner", "SP", "planner is one of fmm, sp, got 'SP'"),
        ("--views", "all", "views is one of panoramic, half, got"),
    ],
)
def test_a_setting_that_doesnt_exist_is_named_with_those_that_do(root, tmp_path, option, value, said, typed):
    code, stdout, stderr = typed("bench", "run", "--root", root, "--out", tmp_path / "run", option, value)
    assert (code, stdout) == (1, "")
    assert stderr.startswith(f"error: {said}")


def kept(run):
    """The episodes that a run's folder holds, as their records say but for the time they took."""
    if not (run / "settings.json").exists():
        return []
    return [msgspec.structs.replace(record, seconds=0.0) for record in read(run)]


def test_a_run_that_was_killed_goes_on_and_comes_to_the_same(root, tmp_path):
    def arguments(out):
        return ("bench", "run", "--root", root, "--out", out, "--perception", "oracle", "--workers", 1)

    killed, whole = tmp_path / "killed", tmp_path / "whole"
    process = subprocess.Popen(
        [sys.executable, "-m", "surveilnav.cli.main", *map(str, arguments(killed))], stderr=subprocess.PIPE
    )
    try:
        until = time.monotonic() + 200.0
        while not kept(killed):
            assert process.poll() is None, process.stderr.read().decode()
            assert time.monotonic() < until
            time.sleep(0.02)
    finally:
        process.kill()
        process.communicate()
    before = kept(killed)
    assert 1 <= len(before) < 6
    assert surveilnav(*arguments(killed)).returncode == 0
    assert surveilnav(*arguments(whole)).returncode == 0
    assert len(kept(whole)) == 6
    assert kept(killed) == kept(whole)
    assert [r for r in kept(killed) if r in before] == before


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("bench", "run", "--policy", "best"), "there is no policy 'best'"),
        (("bench", "run", "--surveillance", "maybe"), "on or off"),
        (("bench", "run", "--planner", "warp"), "warp"),
        (("bench", "run", "--localisation", "drift=0.1"), "only a robot that drives to waypoints has a localisation"),
        (("bench", "run", "--drive", "waypoints", "--localisation", "wheels=4"), "unknown field `wheels`"),
        (("bench", "run", "--localisation", "drift=much"), "expected numbers, such as drift=0.01"),
        (("bench", "run", "--root", "/nowhere"), "surveilnav dataset build"),
        (("bench", "table", "best"), "there is no table 'best'"),
        (("bench", "table", "range", "--arm", "720"), "no arm has '720' in its label; there are: 360 degrees"),
        (("bench", "table", "--arm", "720"), "name the table"),
        (("bench", "table", "range", "--arm", "180", "--no-play"), "leave one of them out"),
        (("dataset", "check", "--root", "/nowhere"), "surveilnav dataset build"),
        (("dataset", "build", "--split", "vla"), "there is no split 'vla'"),
    ],
)
def test_a_mistake_is_one_line(arguments, said, typed):
    code, _, stderr = typed(*arguments)
    assert code != 0
    assert said in stderr
    assert "Traceback" not in stderr


def test_check_names_faults_and_says_so_by_its_exit(root, tmp_path):
    assert surveilnav("dataset", "check", "--root", root).returncode == 0
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(root, copy)
    (copy / "val_mini" / "cameras" / "parametric_flat-s0.json.gz").unlink()
    done = surveilnav("dataset", "check", "--root", copy, "--json")
    assert done.returncode == 1
    said = json.loads(done.stdout)
    assert any("parametric_flat-s0" in f["where"] and f["level"] == "error" for f in said["faults"])
    assert said["errors"] + said["notes"] == len(said["faults"])


@pytest.mark.parametrize(
    ("arguments", "asked"),
    [
        (["range"], {"range": ["360 degrees", "180 degrees", "no cameras"]}),
        (["range", "--no-play"], {"range": []}),
        (["range", "density", "--arm", "degrees"], {"range": ["360 degrees", "180 degrees"]}),
        (["delay", "--arm", "0 steps"], {"delay": ["0 steps"]}),
        (
            ["--arm", "VLFM", "--arm", "SP"],
            {
                "main": [
                    "ours, with surveillance, SP",
                    "ours, without surveillance, SP",
                    "VLFM's rule",
                    "VLFM's rule, our verification",
                ],
                "rules": ["VLFM's rule", "VLFM's rule, our verification"],
            },
        ),
    ],
)
def test_tables_play_the_arms_that_are_asked_for(arguments, asked, monkeypatch, tmp_path):
    made = {}

    def make(table, root, out, *, wanted, **_):
        made[table.name] = [arm.label for arm in table.arms if wanted(arm)]
        return Made(out / f"{table.name}.md", [], True, 1, [])

    def expect_own_runs(tables, root, out, wanted):  # the dataset isn't built here
        looked_at.update({t.name: [arm.label for arm in t.arms if wanted(arm)] for t in tables})

    looked_at = {}
    monkeypatch.setattr("surveilnav.benchmark.tables.make.make", make)
    monkeypatch.setattr("surveilnav.benchmark.tables.make.expect_own_runs", expect_own_runs)
    done = CliRunner().invoke(app, ["table", *arguments, "--out", str(tmp_path), "--json"])
    assert done.exit_code == 0
    assert made == looked_at == asked
    assert "nothing was played with this program (1 of " in " ".join(done.output.split())
    said = json.loads(done.stdout)["tables"]
    assert [t["table"] for t in said] == list(asked)
    assert all(t["complete"] and t["played"] == 1 and t["page"] is None and not t["not_counted"] for t in said)


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (OSError(errno.ENOSPC, "No space left on device"), "error: No space left on device; make room and run again"),
        (OSError(errno.ENOENT, "No such file or directory", "a.json"), "error: a.json: No such file or directory"),
    ],
)
def test_what_the_disk_refuses_is_one_line(error, said, monkeypatch, capsys):
    def refuse(**_):
        raise error

    monkeypatch.setattr("surveilnav.cli.main.app", refuse)
    monkeypatch.setattr("surveilnav.cli.main.signal.signal", lambda *_: None)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert capsys.readouterr().err.strip() == said


def test_a_bug_keeps_its_traceback(monkeypatch):
    def fail(**_):
        raise OSError("bug")

    monkeypatch.setattr("surveilnav.cli.main.app", fail)
    monkeypatch.setattr("surveilnav.cli.main.signal.signal", lambda *_: None)
    with pytest.raises(OSError, match="bug"):
        main()
