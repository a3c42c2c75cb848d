"""The file of API keys: keys are shown once and stored as hashes, names are told apart, and a bad file lets nobody in."""

from __future__ import annotations

import json
import stat
import threading
from pathlib import Path

import pytest

from surveilnav.errors import ConfigError
from surveilnav.security.api_keys import ApiKeysFile, split_key
from surveilnav.security.roles import Role


@pytest.fixture
def file(tmp_path: Path) -> ApiKeysFile:
    return ApiKeysFile(tmp_path / "keys.json")


def test_a_key_is_shown_once_and_stored_as_a_hash(file):
    shown = file.add("anna", Role.operator)
    parts = split_key(shown)
    assert parts
    (stored,) = file.read()
    assert (stored.id, stored.name, stored.role) == (parts[0], "anna", Role.operator)
    assert stored.hash.startswith("$argon2id$")
    assert parts[1] not in file.path.read_text()
    assert stored.matches(parts[1])
    assert not stored.matches(parts[1][:-1] + ("A" if parts[1][-1] != "A" else "B"))
    assert stat.S_IMODE(file.path.stat().st_mode) == 0o600


def test_keys_are_rotated_and_revoked_by_name(file):
    old = file.add("anna", Role.admin)
    other = file.add("pump", Role.viewer)
    new = file.rotate("anna")
    by_name = {key.name: key for key in file.read()}
    assert by_name["anna"].role is Role.admin
    assert by_name["anna"].matches(split_key(new)[1])  # type: ignore[index]
    assert not by_name["anna"].matches(split_key(old)[1])  # type: ignore[index]
    file.revoke("anna")
    (left,) = file.read()
    assert left.matches(split_key(other)[1])  # type: ignore[index]
    with pytest.raises(ConfigError, match=r"no key 'anna'.*it has: pump"):
        file.revoke("anna")


def test_a_name_is_for_one_key(file):
    file.add("anna", Role.viewer)
    with pytest.raises(ConfigError, match="rotate anna"):
        file.add("anna", Role.admin)
    with pytest.raises(ConfigError, match="a key's name"):
        file.add("an na", Role.admin)
    assert [key.role for key in file.read()] == [Role.viewer]


def test_changes_at_once_lose_nothing(file):
    threads = [threading.Thread(target=file.add, args=(f"k{i}", Role.viewer)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {key.name for key in file.read()} == {f"k{i}" for i in range(8)}


def test_rights_are_kept(file):
    file.add("anna", Role.viewer)
    file.path.chmod(0o640)  # a group may read it: that of the gateway's container
    file.add("bert", Role.viewer)
    assert stat.S_IMODE(file.path.stat().st_mode) == 0o640


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: path.chmod(0o644), "file of API keys .* open to others"),
        (lambda path: path.write_text("{"), "it has something else"),
        (lambda path: path.write_text(json.dumps({"keys": [{"id": "x"}]})), "it has something else"),
        (
            lambda path: path.write_text(path.read_text().replace('"viewer"', '"emperor"')),
            "it has something else",
        ),
        (lambda path: path.unlink(), "can't be read"),
    ],
)
def test_faults_are_named(file, spoil, said):
    file.add("anna", Role.viewer)
    spoil(file.path)
    with pytest.raises(ConfigError, match=said):
        file.read()


@pytest.mark.parametrize("text", ["", "snav", "snav_xyz_abc", "snav_0123abcd_short", "Snav_0123abcd_" + "a" * 43])
def test_what_is_no_key(text):
    assert split_key(text) is None
