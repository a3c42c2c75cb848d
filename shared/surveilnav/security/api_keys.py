"""Keys for the REST interface: each has a name and a role, and is stored as a hash (argon2id) that can't be turned back.

    snav_4f1c09be_Qm9...      a key: its id, by which it is found in the file, and its secret

The file is JSON, and readable by its owner and group alone. A key is shown once, when it is made.
"""

from __future__ import annotations

import json
import os
import re
import secrets
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from argon2 import PasswordHasher
from argon2.exceptions import InvalidHashError, VerificationError

from surveilnav.contract import ID_PATTERN
from surveilnav.errors import ConfigError
from surveilnav.security.certificates import fault_of_rights
from surveilnav.security.roles import Role
from surveilnav.storage import atomic_write, file_lock

_KEY = re.compile(r"snav_(?P<id>[0-9a-f]{8})_(?P<secret>[A-Za-z0-9_-]{43})")
#: RFC 9106's variant argon2id with OWASP's parameters: 19 MiB and about 20 ms. A secret has 256 bits, so nobody guesses it; the
#: hash only keeps who reads the file from having the keys.
_HASHER = PasswordHasher(time_cost=2, memory_cost=19_456, parallelism=1)
MAX_KEYS = 1000


@dataclass(frozen=True, slots=True)
class ApiKey:
    """One key as it is stored. ``hash``: of its secret."""

    id: str
    name: str
    role: Role
    hash: str
    created: str

    def matches(self, secret: str) -> bool:
        """Whether this is its secret. Takes about 20 ms, on purpose."""
        try:
            return _HASHER.verify(self.hash, secret)
        except (VerificationError, InvalidHashError):
            return False


def split_key(presented: str) -> tuple[str, str] | None:
    """The id and the secret in what somebody presents as a key; None: it isn't one."""
    match = _KEY.fullmatch(presented)
    return (match["id"], match["secret"]) if match else None


@dataclass(frozen=True, slots=True)
class ApiKeysFile:
    """The file of keys. Its methods raise ConfigError if it can't be read or has faults."""

    path: Path

    def read(self) -> list[ApiKey]:
        """All keys."""
        if fault := fault_of_rights(self.path):
            raise ConfigError(fault.replace("the key ", "the file of API keys ", 1))
        try:
            rows = json.loads(self.path.read_text(encoding="utf-8"))["keys"]
            return [_parse(row) for row in rows[:MAX_KEYS]]
        except OSError as error:
            raise ConfigError(f"the file of API keys {self.path} can't be read: {error.strerror}") from None
        except (ValueError, KeyError, TypeError, RecursionError):
            raise ConfigError(
                f"expected the keys as `surveilnav security key` writes them in {self.path}; it has something else"
            ) from None

    def add(self, name: str, role: Role) -> str:
        """Makes a key, and returns it: it is stored nowhere.

        Raises:
            ConfigError: there is a key of that name, or the name isn't one.
        """
        if not re.fullmatch(ID_PATTERN, name):
            raise ConfigError(f"a key's name has letters, digits, '_', '.', '-' (at most 64), got {name!r:.80}")
        return self._change(lambda keys: self._added(keys, name, role))

    def rotate(self, name: str) -> str:
        """Replaces a key, and returns the new one, with the same name and role. The old one is void."""

        def rotated(keys: list[ApiKey]) -> tuple[list[ApiKey], str]:
            old = self._named(keys, name)
            return self._added([key for key in keys if key is not old], name, old.role)

        return self._change(rotated)

    def revoke(self, name: str) -> None:
        """Makes a key void."""

        def revoked(keys: list[ApiKey]) -> tuple[list[ApiKey], str]:
            old = self._named(keys, name)
            return [key for key in keys if key is not old], ""

        self._change(revoked)

    def _named(self, keys: Iterable[ApiKey], name: str) -> ApiKey:
        found = next((key for key in keys if key.name == name), None)
        if found is None:
            names = ", ".join(key.name for key in keys) or "none"
            raise ConfigError(f"no key {name!r:.80} in {self.path}; it has: {names}")
        return found

    def _added(self, keys: list[ApiKey], name: str, role: Role) -> tuple[list[ApiKey], str]:
        if any(key.name == name for key in keys):
            raise ConfigError(f"there is a key {name!r} already: `surveilnav security key rotate {name}` replaces it")
        if len(keys) >= MAX_KEYS:
            raise ConfigError(f"{self.path} has {MAX_KEYS} keys, which is the most: revoke some")
        id, secret = secrets.token_hex(4), secrets.token_urlsafe(32)
        created = datetime.now(UTC).isoformat(timespec="seconds")
        return [*keys, ApiKey(id, name, role, _HASHER.hash(secret), created)], f"snav_{id}_{secret}"

    def _change(self, change: Callable[[list[ApiKey]], tuple[list[ApiKey], str]]) -> str:
        """Writes what ``change`` makes of the keys, and returns the new key. Two changes at once follow each other."""
        try:
            with file_lock(self.path.with_name(f".{self.path.name}.lock")):
                keys, new = change(self.read() if self.path.exists() else [])
                rows = [{**asdict(key), "role": key.role.name} for key in keys]
                mode, owner = _rights_of(self.path)
                with atomic_write(self.path) as file:
                    os.fchmod(file.fileno(), mode)
                    if owner is not None:
                        os.fchown(file.fileno(), *owner)
                    file.write(json.dumps({"keys": rows}, indent=1).encode())
        except OSError as error:
            raise ConfigError(f"the file of API keys {self.path} can't be written: {error.strerror}") from None
        return new


def _rights_of(path: Path) -> tuple[int, tuple[int, int] | None]:
    """The rights and the owner to write a file with: those that it has. A new one is for its owner alone."""
    try:
        found = path.stat()
    except FileNotFoundError:
        return 0o600, None
    mine = (found.st_uid, found.st_gid) == (os.geteuid(), os.getegid())
    return found.st_mode & 0o777, None if mine else (found.st_uid, found.st_gid)


def _parse(row: dict[str, str]) -> ApiKey:
    return ApiKey(
        id=str(row["id"]),
        name=str(row["name"]),
        role=Role[row["role"]],
        hash=str(row["hash"]),
        created=str(row["created"]),
    )
