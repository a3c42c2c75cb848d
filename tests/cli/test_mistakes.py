"""What a program reads that runs `surveilnav ... --json` and makes a mistake."""

from __future__ import annotations

import json

import pytest

from cli.main import main
from surveilnav.bus.router import free_port


@pytest.fixture
def typed(monkeypatch, capsys, tmp_path):
    """``typed(*arguments)``: exit status, stdout, stderr of `surveilnav ...`."""
    monkeypatch.setattr("cli.main.signal.signal", lambda *_: None)
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
        (("dataset", "build", "--split", "a", "--split", "b", "--building", "studio"), "ConfigError", None, "one split"),
    ],
)  # fmt: skip
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
