"""The folder with everything secret of a building: its authority, identities and the router's access rules.

ca.pem                              the authority's certificate: everybody has it
ca.key                              its key: it stays here; who has it can make any identity
building.json                       for which building, and whether its cameras and robots are simulated
access.json                         the router's access rules, made from the contract and the identities below
identities/camera-lobby/ca.pem      what one process gets: its folder, and nothing else of this
identities/camera-lobby/certificate.pem
identities/camera-lobby/key.pem
"""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from surveilnav.contract import ID_PATTERN
from surveilnav.errors import ConfigError
from surveilnav.security.access import access_control
from surveilnav.security.certificates import (
    KeyPair,
    belongs_to,
    common_name,
    fault_of_rights,
    fault_of_time,
    is_issued_by,
    issue,
    make_authority,
    read_certificate,
    read_key,
)
from surveilnav.security.identities import Identity, identity_from_name

AUTHORITY_VALID = timedelta(days=3650)
#: There is no list of revoked certificates: what was stolen can be used until it expires, or its name is removed.
IDENTITY_VALID = timedelta(days=398)
_SOON = timedelta(days=30)
CA, CA_KEY, ACCESS, _BUILDING, _IDENTITIES = "ca.pem", "ca.key", "access.json", "building.json", "identities"
CERTIFICATE, KEY = "certificate.pem", "key.pem"


@dataclass(frozen=True, slots=True)
class SecurityFolder:
    """A folder as described above. Its methods raise ConfigError for what is missing or can't be read."""

    path: Path

    @classmethod
    def create(
        cls,
        path: Path,
        building: str,
        identities: Iterable[Identity],
        router_names: tuple[str, ...],
        *,
        simulation: bool = False,
        now: datetime | None = None,
    ) -> SecurityFolder:
        """A new folder with an authority and identities. ``router_names``: hosts by which the router is reached.

        Raises:
            ConfigError: there is something already, which is never overwritten; or the building's name can't stand in a key.
        """
        if not re.fullmatch(ID_PATTERN, building):
            raise ConfigError(
                f"a building's name has letters, digits, '_', '.', '-' (at most 64), got {building!r:.80}"
            )
        if path.exists() and (not path.is_dir() or any(path.iterdir())):
            raise ConfigError(f"{path} isn't empty: what is there is never overwritten. Name another folder.")
        path.mkdir(parents=True, mode=0o700, exist_ok=True)
        path.chmod(0o700)
        authority = make_authority(building, now or datetime.now(UTC), AUTHORITY_VALID)
        folder = cls(path)
        _write(path / CA, authority.certificate_pem, secret=False)
        _write(path / CA_KEY, authority.key_pem, secret=True)
        facts = {"building": building, "simulation": simulation, "router_names": list(router_names)}
        _write(path / _BUILDING, json.dumps(facts, indent=1).encode(), secret=False)
        for identity in dict.fromkeys(identities):
            folder._issue(authority, identity, now)
        folder.write_rules()
        return folder

    @property
    def building(self) -> str:
        """The building's name in the keys that the rules are about."""
        return str(self._facts()["building"])

    # --- identities -----------------------------------------------------------------------------------------------

    def names(self) -> list[str]:
        """The names of all identities."""
        folder = self.path / _IDENTITIES
        if not folder.is_dir():
            raise ConfigError(f"no identities in {self.path}: make them by `surveilnav security init {self.path}`")
        return sorted(p.name for p in folder.iterdir() if p.is_dir() and not p.name.startswith("."))

    def identity_folder(self, name: str) -> Path:
        """The folder to hand out for an identity."""
        folder = self.path / _IDENTITIES / name
        if not folder.is_dir():
            raise ConfigError(
                f"no identity {name!r:.100} in {self.path}: issue it by `surveilnav security issue {self.path} {name:.100}`"
            )
        return folder

    def issue(self, identity: Identity, now: datetime | None = None) -> Path:
        """Issues a new identity, adds it to the rules, and returns its folder.

        Raises:
            ConfigError: it exists already.
        """
        if (self.path / _IDENTITIES / identity.name).exists():
            raise ConfigError(
                f"{identity.name} has an identity already: `surveilnav security renew {self.path} {identity.name}` replaces it"
            )
        folder = self._issue(self._authority(), identity, now)
        self.write_rules()
        return folder

    def renew(self, name: str, now: datetime | None = None) -> Path:
        """Gives an identity a new key and certificate, and returns its folder. The old ones can be used until they expire."""
        folder, identity = self.identity_folder(name), identity_from_name(name)
        authority = self._authority()
        old = folder.with_name(f".{name}.old")
        shutil.rmtree(old, ignore_errors=True)
        folder.rename(old)
        try:
            self._issue(authority, identity, now)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            old.rename(folder)
            raise
        shutil.rmtree(old)
        return folder

    def remove(self, name: str) -> None:
        """Removes an identity: once the router has started with the new rules, nobody of that name may do anything."""
        shutil.rmtree(self.identity_folder(name))
        self.write_rules()

    def _authority(self) -> KeyPair:
        return KeyPair(read_certificate(self.path / CA), read_key(self.path / CA_KEY))

    def _issue(self, authority: KeyPair, identity: Identity, now: datetime | None) -> Path:
        reached_as = tuple(self._facts()["router_names"]) if identity.kind == "router" else ()  # type: ignore[arg-type]
        pair = issue(authority, identity.name, now or datetime.now(UTC), IDENTITY_VALID, reached_as)
        folder = self.path / _IDENTITIES / identity.name
        folder.mkdir(parents=True, mode=0o700)
        _write(folder / CA, authority.certificate_pem, secret=False)
        _write(folder / CERTIFICATE, pair.certificate_pem, secret=False)
        _write(folder / KEY, pair.key_pem, secret=True)
        return folder

    # --- rules ----------------------------------------------------------------------------------------------------

    def write_rules(self) -> None:
        """Writes the router's access rules for the identities that there are. A router reads them when it starts."""
        temporary = self.path / f".{ACCESS}.new"
        temporary.write_text(json.dumps(self._rules(), indent=1), encoding="utf-8")
        temporary.replace(self.path / ACCESS)

    def _rules(self) -> dict[str, object]:
        """The rules for the identities that there are."""
        facts, identities = self._facts(), [identity_from_name(name) for name in self.names()]
        return access_control(identities, str(facts["building"]), simulation=facts["simulation"] is True)

    def _facts(self) -> dict[str, object]:
        path = self.path / _BUILDING
        try:
            facts = json.loads(path.read_text(encoding="utf-8"))
            if not re.fullmatch(ID_PATTERN, facts["building"]):
                raise ValueError
            return {
                "building": facts["building"],
                "simulation": facts["simulation"],
                "router_names": facts["router_names"],
            }
        except OSError as error:
            raise ConfigError(
                f"{path} can't be read ({error.strerror}): `surveilnav security init {self.path}` makes it"
            ) from None
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ConfigError(f"expected building, simulation and router_names as JSON in {path}") from None

    # --- check ----------------------------------------------------------------------------------------------------

    def faults(self, now: datetime | None = None) -> list[str]:
        """Everything that is wrong: rights, times, keys that don't belong to their certificates, names that are there twice."""
        now = now or datetime.now(UTC)
        authority = read_certificate(self.path / CA)
        faults = [f"ca.pem: {fault}" for fault in [fault_of_time(authority, now)] if fault]
        if (self.path / CA_KEY).exists() and (fault := _fault_of_key(self.path / CA_KEY, self.path / CA)):
            faults.append(f"ca.key: {fault}")
        owners: dict[str, list[str]] = {}
        for name in self.names():
            folder = self.path / _IDENTITIES / name
            faults += [f"identities/{name}: {fault}" for fault in _faults_of_identity(folder, authority, now, owners)]
        faults += [
            f"identities/{' and identities/'.join(folders)}: both are named {name!r}"
            for name, folders in owners.items()
            if len(folders) > 1
        ]
        return faults + self._faults_of_rules()

    def warnings(self, now: datetime | None = None) -> list[str]:
        """What will be wrong soon."""
        soon = (now or datetime.now(UTC)) + _SOON
        named = [(f"identities/{name}", self.path / _IDENTITIES / name / CERTIFICATE) for name in self.names()]
        found = []
        for where, path in [("ca.pem", self.path / CA), *named]:
            try:
                end = read_certificate(path).not_valid_after_utc
            except ConfigError:
                continue
            if soon - _SOON < end < soon:
                found.append(f"{where}: expires on {end:%Y-%m-%d}")
        return found

    def _faults_of_rules(self) -> list[str]:
        path = self.path / ACCESS
        try:
            written = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return [f"{ACCESS}: it can't be read; `surveilnav security rules {self.path}` makes it anew"]
        try:
            if written == self._rules():
                return []
        except ConfigError as error:
            return [str(error)]
        return [
            f"{ACCESS}: it doesn't agree with the identities and this version of SurveilNav: "
            f"`surveilnav security rules {self.path}` makes it anew; then restart the router"
        ]


def _faults_of_identity(folder: Path, authority: object, now: datetime, owners: dict[str, list[str]]) -> list[str]:
    """What is wrong with one identity; adds it to ``owners``, folders by common name."""
    try:
        certificate = read_certificate(folder / CERTIFICATE)
    except ConfigError as error:
        return [str(error)]
    name = common_name(certificate)
    owners.setdefault(name, []).append(folder.name)
    faults = [fault for fault in [fault_of_time(certificate, now)] if fault]
    if name != folder.name:
        faults.append(f"its certificate is for {name!r}")
    if not is_issued_by(certificate, authority):  # type: ignore[arg-type]
        faults.append("its certificate isn't issued by ca.pem")
    if fault := _fault_of_key(folder / KEY, folder / CERTIFICATE):
        faults.append(fault)
    return faults


def _fault_of_key(key: Path, certificate: Path) -> str | None:
    if fault := fault_of_rights(key):
        return fault
    try:
        if not belongs_to(read_key(key), read_certificate(certificate)):
            return f"{key.name} doesn't belong to {certificate.name}"
    except ConfigError as error:
        return str(error)
    return None


def _write(path: Path, data: bytes, *, secret: bool) -> None:
    """Writes a file that mustn't exist yet; a secret is readable by its owner alone from the beginning."""
    handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if secret else 0o644)
    with os.fdopen(handle, "wb") as file:
        file.write(data)
