"""``surveilnav security`` as a user types it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from surveilnav.cli.main import main


@pytest.fixture
def typed(monkeypatch, capsys, tmp_path):
    """``typed(*arguments)``: exit status, stdout, stderr of `surveilnav security ...`."""
    monkeypatch.setattr("surveilnav.cli.main.signal.signal", lambda *_: None)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("SURVEILNAV_GATEWAY__KEYS_FILE", raising=False)
    monkeypatch.chdir(tmp_path)

    def run(*arguments: str) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["surveilnav", "security", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        said = capsys.readouterr()
        return int(ended.value.code or 0), said.out, said.err

    return run


def test_a_building_from_init_to_remove(typed):
    code, out, err = typed("init", "secrets", "--building", "home", "--cameras", "lobby,gate,2", "--viewers", "wall")
    assert code == 0
    for name in (
        "camera-lobby",
        "camera-gate",
        "camera-spare-1",
        "camera-spare-2",
        "robot-r1",
        "robot-spare-1",
        "viewer-wall",
    ):
        assert name in out
        assert Path("secrets/identities", name, "key.pem").is_file()
    assert "ca.key can make any identity" in err
    assert typed("check", "secrets")[:2] == (0, "everything is in order\n")
    assert typed("issue", "secrets", "camera-hall")[0] == 0
    before = Path("secrets/identities/camera-hall/key.pem").read_text()
    assert typed("renew", "secrets", "camera-hall")[0] == 0
    assert Path("secrets/identities/camera-hall/key.pem").read_text() != before
    code, out, _ = typed("remove", "secrets", "camera-hall")
    assert "Restart the router" in out
    assert "camera-hall" not in Path("secrets/access.json").read_text()
    Path("secrets/access.json").unlink()
    assert typed("rules", "secrets")[0] == 0
    assert typed("check", "secrets")[0] == 0


def test_nothing_is_overwritten(typed):
    assert typed("init", "secrets")[0] == 0
    before = Path("secrets/ca.key").read_bytes()
    code, _, err = typed("init", "secrets")
    assert code == 1
    assert "never overwritten" in err
    assert Path("secrets/ca.key").read_bytes() == before


def test_check_names_faults_and_fails(typed):
    typed("init", "secrets")
    Path("secrets/identities/fusion/key.pem").chmod(0o644)
    code, out, _ = typed("check", "secrets")
    assert code == 1
    assert "fault: identities/fusion" in out
    assert "chmod 600" in out
    code, out, _ = typed("check", "secrets", "--json")
    assert code == 1
    assert len(json.loads(out)["faults"]) == 1


def test_outside_simulation_the_rules_have_no_truth(typed):
    typed("init", "real")
    typed("init", "simulated", "--simulation", "--shared-cameras")
    assert "/truth/" not in Path("real/access.json").read_text()
    assert "/truth/" in Path("simulated/access.json").read_text()
    assert not Path("real/identities/cameras").exists()
    assert Path("simulated/identities/cameras").is_dir()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("check", "nowhere"), "can't be read"),
        (("issue", "nowhere", "camera-x"), "can't be read"),
        (("init", "x", "--cameras", "a b"), "expected an identity"),
        (("init", "x", "--building", "a/b"), "building's name"),
        (("key", "list"), "can't be read"),
        (("key", "revoke", "anna"), "no key 'anna'"),
        (("key", "add", "an na", "--role", "viewer"), "a key's name"),
    ],
)
def test_mistakes_are_a_line(typed, arguments, said):
    code, _, err = typed(*arguments)
    assert code == 1
    assert said in err
    assert "Traceback" not in err


def test_a_role_that_isnt_one_is_a_mistyped_command(typed):
    code, _, err = typed("key", "add", "anna", "--role", "emperor")
    assert code == 2
    assert "viewer, operator, admin" in err


def test_a_key_is_shown_once(typed):
    code, key, err = typed("key", "add", "anna", "--role", "operator", "--file", "keys.json")
    assert code == 0
    assert key.startswith("snav_")
    assert "isn't shown again" in err
    assert key.strip() not in Path("keys.json").read_text()
    code, out, _ = typed("key", "list", "--file", "keys.json")
    assert "anna  operator" in out
    assert key.strip() not in out
    code, out, _ = typed("key", "rotate", "anna", "--file", "keys.json", "--json")
    assert json.loads(out)["key"] != key.strip()
    assert typed("key", "revoke", "anna", "--file", "keys.json")[0] == 0
    assert json.loads(typed("key", "list", "--file", "keys.json", "--json")[1]) == {"items": [], "total": 0}
