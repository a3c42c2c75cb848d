"""What a program reads that runs `surveilnav ... --json` and makes a mistake."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from surveilnav.bus.router import free_port
from surveilnav.cli.main import main


@pytest.fixture
def typed(monkeypatch, capsys, tmp_path):
    """``typed(*arguments)``: exit status, stdout, stderr of `surveilnav ...`."""
    monkeypatch.setattr("surveilnav.cli.main.signal.signal", lambda *_: None)
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["surveilnav", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return run


NOWHERE = f"http://127.0.0.1:{free_port()}"


@pytest.mark.parametrize(
    ("arguments", "type_", "name", "says"),
    [
        (("demo", "--building", "atlantis"), "BuildingError", None, "there is no building 'atlantis'"),
        (("demo", "--building", "parametric_flat", "--target", "unicorn"), "TargetError", None, "unicorn"),
        (("find", "tv", "--url", NOWHERE), "GatewayError", "no_gateway", "surveilnav up"),
        (("status", "--url", "http://127.0.0.1:x"), "GatewayError", "no_gateway", "--url"),
        (("models", "pull", "eyes"), "PerceptionError", None, "eyes"),
        (("bench", "run", "--root", "nowhere"), "ConfigError", None, "nowhere"),
        (("bench", "table", "nowhere"), "ConfigError", None, "nowhere"),
        (("dataset", "check", "--root", "nowhere"), "ConfigError", None, "nowhere"),
        (
            ("dataset", "build", "--split", "a", "--split", "b", "--building", "studio"),
            "ConfigError",
            None,
            "one split",
        ),
    ],
)
def test_a_mistake_is_an_object(typed, arguments, type_, name, says):
    code, out, err = typed(*arguments, "--json")
    assert code == 1
    error = json.loads(out)["error"]
    assert (error["type"], error.get("name")) == (type_, name)
    assert says in error["message"]
    assert err.strip().endswith(f"error: {error['message']}".strip()), "people read the same"


def test_without_json_a_mistake_is_a_line_on_stderr_alone(typed):
    code, out, err = typed("demo", "--building", "atlantis")
    assert (code, out) == (1, "")
    assert "error: there is no building" in err


def test_a_wrong_setting_is_an_object_too(typed, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_SIM__LIGHTING", "neon")
    code, out, _ = typed("demo", "--building", "parametric_flat", "--json")
    error = json.loads(out)["error"]
    assert (code, error["type"]) == (1, "ValidationError")
    assert "SimulationSettings.lighting" in error["message"]


@pytest.mark.parametrize(
    ("arguments", "says"), [(("find",), "target"), (("demo", "--nonsense"), "--nonsense"), (("nothing",), "nothing")]
)
def test_a_command_that_cant_be_is_an_object_too(typed, arguments, says):
    code, out, err = typed(*arguments, "--json")
    assert code == 2
    assert says in json.loads(out)["error"]["message"]
    assert "Usage: surveilnav" in err
    code, out, err = typed(*arguments)
    assert (code, out) == (2, "")
    assert says in err


def test_lists_are_objects_too(typed):
    code, out, _ = typed("buildings", "--json")
    assert code == 0
    told = {row["name"]: row for row in json.loads(out)["items"]}
    assert {"name", "about", "floors", "rooms", "area_m2"} == set(told["studio"])
    house = told["parametric_house"]
    assert (house["floors"], house["rooms"], house["area_m2"]) == (["0", "1"], 12, 160.0)
    _, out, _ = typed("doctor", "--json")
    assert json.loads(out)["findings"]
    code, out, err = typed("buildings")
    assert (code, "Traceback" in err) == (0, False)
    assert "studio" in out
    assert "`surveilnav prepare` fetches" in out


def test_foreign_names_are_shown_and_not_obeyed(typed, tmp_path):
    folder = tmp_path / "homes"
    folder.mkdir()
    name = "a\x1b[2J\x1b]0;owned\x07\u202edh3s.sh3d"
    (folder / name).write_bytes(b"nothing")
    code, out, err = typed("homes", str(folder))
    assert code == 1
    assert "owned" in out
    assert "0 of 1 files could be read" in out
    assert not set("\x1b\x07\u202e") & set(out + err)


@pytest.mark.parametrize("arguments", [("bench", "policies"), ("--help",)])
def test_whoever_reads_may_go_away(arguments):
    read, write = os.pipe()
    os.close(read)
    run = subprocess.run(
        [sys.executable, "-m", "surveilnav.cli.main", *arguments],
        stdout=write,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(write)
    assert (run.returncode, run.stderr) == (1, "")
