"""Knows whose a key or a session is.

A program sends its key as ``Authorization: Bearer KEY``. A page can't add headers to an event stream or a picture, so it
exchanges the key for a session once, whose cookie no script can read and no other site can have sent.
"""

from __future__ import annotations

import hashlib
import hmac
import secrets
import threading
import time
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

import structlog

from surveilnav.errors import ConfigError
from surveilnav.security.api_keys import ApiKey, ApiKeysFile, split_key
from surveilnav.services.gateway.core.attempts import FailedAttempts
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.requester import Person
from surveilnav.storage import file_stamp

#: How long a session lasts, and how many there may be.
SESSION_S = 12 * 3600.0
_MAX_SESSIONS = 1000
#: Keys that are compared with their hashes at the same time: each takes 19 MiB.
_AT_ONCE = 2


@dataclass(frozen=True, slots=True)
class _Session:
    key: ApiKey
    ends_s: float


class Authentication:
    """Tells who a key or a session belongs to. Thread-safe; comparing a key that is new here takes about 20 ms.

    Args:
        keys_file: the file of keys, which is read again when it changes; None: there are none, so nobody is let in.
    """

    def __init__(self, keys_file: Path | None) -> None:
        self._file = None if keys_file is None else ApiKeysFile(keys_file)
        self._keys: dict[str, ApiKey] = {}
        self._stamp: tuple[int, ...] | None = None
        self._fault = ""
        #: Digests of keys that were compared already, under a secret of this process: so a request costs microseconds.
        self._secret = secrets.token_bytes(32)
        self._verified: dict[bytes, ApiKey] = {}
        self._sessions: OrderedDict[bytes, _Session] = OrderedDict()
        self._failed = FailedAttempts()
        self._lock, self._comparing = threading.Lock(), threading.Semaphore(_AT_ONCE)
        self._log = structlog.get_logger()

    def key_owner(self, presented: str, client: str) -> Person:
        """Whose key this is. ``client``: the address that presents it.

        Raises:
            Problem: 401: nobody's; 429: the client has presented too many wrong ones.
        """
        return _person(self._key(presented, client))

    def known_owner(self, presented: str) -> Person | None:
        """Whose key this is, if it was compared before; None: ``key_owner`` must compare it, which takes time."""
        with self._lock:
            self._read_if_changed()
            key = self._verified.get(self._digest(presented))
        return _person(key) if key else None

    def is_current(self, person: Person) -> bool:
        """Whether the key of somebody who was let in is still there."""
        with self._lock:
            self._read_if_changed()
            key = self._keys.get(person.key_id)
        return key is not None and _person(key) == person

    def open_session(self, presented: str, client: str) -> tuple[str, Person]:
        """A new session for a key, as the text of its cookie. Raises Problem as ``key_owner`` does."""
        key = self._key(presented, client)
        token = secrets.token_urlsafe(32)
        with self._lock:
            self._sessions[self._digest(token)] = _Session(key, time.monotonic() + SESSION_S)
            while len(self._sessions) > _MAX_SESSIONS:
                self._sessions.popitem(last=False)
        return token, _person(key)

    def session_owner(self, token: str) -> Person | None:
        """Whose session this is; None: it has ended, its key was revoked, or there never was one."""
        with self._lock:
            self._read_if_changed()
            session = self._sessions.get(self._digest(token))
            if session is None or session.ends_s < time.monotonic() or self._keys.get(session.key.id) != session.key:
                return None
            return _person(session.key)

    def close_session(self, token: str) -> None:
        """Ends a session."""
        with self._lock:
            self._sessions.pop(self._digest(token), None)

    def _key(self, presented: str, client: str) -> ApiKey:
        digest = self._digest(presented)
        with self._lock:
            self._read_if_changed()
            if known := self._verified.get(digest):
                return known
            if self._fault:
                raise Problem(503, "keys_unreadable", "the gateway can't read its file of keys; its log says why")
            if (wait_s := self._failed.wait_s(client, time.monotonic())) > 0:
                raise too_many_failures(wait_s)
            parts = split_key(presented)
            candidate = self._keys.get(parts[0]) if parts else None
        if parts and candidate:
            with self._comparing:
                matches = candidate.matches(parts[1])
            with self._lock:
                if matches and self._keys.get(candidate.id) == candidate:  # not revoked meanwhile
                    self._verified[digest] = candidate
                    return candidate
        with self._lock:
            self._failed.record_failure(client, time.monotonic())
        self._log.warning("a wrong key", client=client, id=parts[0] if parts else "")
        raise Problem(401, "wrong_key", "this key isn't known here, or was revoked")

    def _digest(self, secret: str) -> bytes:
        return hmac.digest(self._secret, secret.encode("utf-8", "surrogatepass"), hashlib.sha256)

    def _read_if_changed(self) -> None:
        """Reads the file if it changed. While it can't be read nobody is let in, and the log says why."""
        if self._file is None:
            return
        if (stamp := file_stamp(self._file.path)) == self._stamp:
            return
        self._stamp = stamp
        self._verified.clear()
        try:
            keys, self._fault = self._file.read(), ""
        except ConfigError as error:
            keys, self._fault = [], str(error)
            self._log.error("nobody is let in", why=self._fault)
        self._keys = {key.id: key for key in keys}


def _person(key: ApiKey) -> Person:
    return Person(key.name, key.role, key.id)


def too_many_failures(wait_s: float) -> Problem:
    """The problem of a client that has presented too many wrong keys. ``retry_after_s`` becomes a header."""
    seconds = int(wait_s) + 1
    return Problem(
        429,
        "too_many_wrong_keys",
        f"too many wrong keys came from here; try again in {seconds} s",
        retry_after_s=seconds,
    )
