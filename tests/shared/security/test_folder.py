"""The folder of a building's secrets: what is made, what is never overwritten, and what is found wrong with it."""

from __future__ import annotations

import json
import shutil
import stat
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from surveilnav.contract import ROUTER
from surveilnav.errors import ConfigError
from surveilnav.security.certificates import common_name, issue, make_authority, read_certificate, read_key
from surveilnav.security.folder import ACCESS, CA_KEY, CERTIFICATE, KEY, SecurityFolder
from surveilnav.security.identities import identity_from_name

NAMES = ("router", "fusion", "planner", "camera-lobby", "robot-r1")


def make(path: Path, now: datetime | None = None) -> SecurityFolder:
    return SecurityFolder.create(path, "home", map(identity_from_name, NAMES), ("localhost", "10.0.0.7"), now=now)


@pytest.fixture
def folder(tmp_path: Path) -> SecurityFolder:
    return make(tmp_path / "security")


def test_everything_is_made_and_right(folder):
    assert folder.names() == sorted(NAMES)
    assert folder.faults() == []
    assert folder.warnings() == []
    for name in NAMES:
        certificate = read_certificate(folder.identity_folder(name) / CERTIFICATE)
        assert common_name(certificate) == name


def test_secrets_are_for_their_owner_alone(folder):
    secrets = [folder.path / CA_KEY, *(folder.identity_folder(name) / KEY for name in NAMES)]
    assert {stat.S_IMODE(path.stat().st_mode) for path in secrets} == {0o600}
    assert stat.S_IMODE(folder.path.stat().st_mode) == 0o700
    hidden = [read_key(path) for path in secrets]
    assert len({key.private_numbers().private_value for key in hidden}) == len(secrets)


def test_only_the_router_can_be_a_server(folder):
    from cryptography.x509 import ExtendedKeyUsage, SubjectAlternativeName
    from cryptography.x509.oid import ExtendedKeyUsageOID

    for name in NAMES:
        extensions = read_certificate(folder.identity_folder(name) / CERTIFICATE).extensions
        usages = extensions.get_extension_for_class(ExtendedKeyUsage).value
        assert (ExtendedKeyUsageOID.SERVER_AUTH in usages) == (name == "router")
    router = read_certificate(folder.identity_folder("router") / CERTIFICATE)
    hosts = router.extensions.get_extension_for_class(SubjectAlternativeName).value
    assert [str(host.value) for host in hosts] == ["localhost", "10.0.0.7"]


def test_nothing_is_ever_overwritten(folder):
    before = {path: path.read_bytes() for path in folder.path.rglob("*") if path.is_file()}
    with pytest.raises(ConfigError, match="never overwritten"):
        make(folder.path)
    with pytest.raises(ConfigError, match="has an identity already"):
        folder.issue(identity_from_name("camera-lobby"))
    assert {path: path.read_bytes() for path in folder.path.rglob("*") if path.is_file()} == before


def test_an_identity_is_issued_renewed_and_removed(folder):
    folder.issue(identity_from_name("camera-gate"))
    assert "camera-gate" in (folder.path / ACCESS).read_text()
    old = (folder.identity_folder("camera-gate") / KEY).read_bytes()
    folder.renew("camera-gate")
    assert (folder.identity_folder("camera-gate") / KEY).read_bytes() != old
    assert folder.faults() == []
    folder.remove("camera-gate")
    assert "camera-gate" not in (folder.path / ACCESS).read_text()
    assert folder.faults() == []
    with pytest.raises(ConfigError, match="no identity 'camera-gate'"):
        folder.renew("camera-gate")


def test_a_renewal_that_fails_leaves_what_was_there(folder, monkeypatch):
    before = (folder.identity_folder("fusion") / KEY).read_bytes()
    monkeypatch.setattr("surveilnav.security.folder.issue", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        folder.renew("fusion")
    assert (folder.identity_folder("fusion") / KEY).read_bytes() == before


def _expired(folder: SecurityFolder) -> None:
    _replace(folder, datetime.now(UTC) - timedelta(days=9))


def _early(folder: SecurityFolder) -> None:
    _replace(folder, datetime.now(UTC) + timedelta(days=9))


def _replace(folder: SecurityFolder, now: datetime) -> None:
    pair = issue(folder._authority(), "fusion", now, timedelta(days=1))
    (folder.identity_folder("fusion") / CERTIFICATE).write_bytes(pair.certificate_pem)
    (folder.identity_folder("fusion") / KEY).write_bytes(pair.key_pem)


def _foreign(folder: SecurityFolder) -> None:
    pair = issue(make_authority("x", datetime.now(UTC), timedelta(9)), "fusion", datetime.now(UTC), timedelta(9))
    (folder.identity_folder("fusion") / CERTIFICATE).write_bytes(pair.certificate_pem)
    (folder.identity_folder("fusion") / KEY).write_bytes(pair.key_pem)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda f: (f.identity_folder("fusion") / KEY).chmod(0o644), "identities/fusion: the key .* open to others"),
        (lambda f: (f.identity_folder("fusion") / KEY).chmod(0o660), "identities/fusion: the key .* open to others"),
        (lambda f: (f.path / CA_KEY).chmod(0o604), "ca.key: .* open to others"),
        (_expired, "identities/fusion: expired at"),
        (_early, "identities/fusion: is valid only from"),
        (_foreign, "identities/fusion: .*isn't issued by ca.pem"),
        (
            lambda f: shutil.copy(f.identity_folder("planner") / KEY, f.identity_folder("fusion") / KEY),
            "identities/fusion: key.pem doesn't belong to certificate.pem",
        ),
        (
            lambda f: shutil.copytree(f.identity_folder("fusion"), f.path / "identities" / "gateway"),
            "identities/fusion and identities/gateway: both are named 'fusion'",
        ),
        (lambda f: (f.identity_folder("fusion") / CERTIFICATE).unlink(), "certificate.pem can't be read"),
        (lambda f: (f.path / ACCESS).write_text("{}"), "access.json: it doesn't agree"),
        (lambda f: (f.path / ACCESS).write_text("{"), "access.json: it can't be read"),
        (lambda f: (f.path / ACCESS).unlink(), "access.json: it can't be read"),
        (lambda f: (f.path / "identities" / "kitchen").mkdir(), "kitchen"),
    ],
)
def test_faults_are_named(folder, spoil, said):
    import re

    spoil(folder)
    faults = folder.faults()
    assert any(re.search(said, fault) for fault in faults), faults


def test_what_expires_soon_is_a_warning(tmp_path):
    folder = make(tmp_path / "security", now=datetime.now(UTC) - timedelta(days=380))
    assert folder.faults() == []
    assert len(folder.warnings()) == len(NAMES)
    assert "identities/fusion: expires on" in "".join(folder.warnings())


def test_the_group_may_read_a_key(folder):
    """So that a container's user can, without everybody else."""
    (folder.identity_folder("fusion") / KEY).chmod(0o640)
    assert folder.faults() == []


@pytest.mark.parametrize(
    "name", ["kitchen", "camera", "camera-", "fusion-2", "camera-../x", "camera-a b", "", "CAMERA-x"]
)
def test_names_that_are_none(name):
    with pytest.raises(ConfigError, match="expected an identity"):
        identity_from_name(name)


def test_a_name_fits_into_a_certificate():
    assert identity_from_name("camera-" + "x" * 57).name.endswith("x")
    with pytest.raises(ConfigError, match="at most 64"):
        identity_from_name("camera-" + "x" * 58)


def test_a_building_that_cant_be_a_key(tmp_path):
    with pytest.raises(ConfigError, match="a building's name"):
        SecurityFolder.create(tmp_path / "x", "a/b", [], ())
    assert not (tmp_path / "x").exists()


def test_the_rules_are_for_the_building(folder):
    rules = json.loads((folder.path / ACCESS).read_text())
    keys = {key for rule in rules["rules"] for key in rule["key_exprs"]}
    keys.remove(ROUTER.format(contract="*", release="*"))  # which contract the router speaks holds for all buildings
    assert {key.split("/")[2] for key in keys} == {"home"}
