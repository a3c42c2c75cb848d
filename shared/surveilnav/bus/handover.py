"""Large payloads that processes of one machine hand each other in a folder in memory, instead of sending them over the bus.

Who has a payload writes it under the hash of its bytes, and tells the reader this name alone. That both see the same folder is
known by its token, which the reader tells when it asks. Old payloads make room for new ones and are removed after a while, so a
reader may find that one is gone: then it is sent after all.
"""

from __future__ import annotations

import hashlib
import os
import re
import secrets
import stat
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from surveilnav.bus.settings import MAX_MESSAGE_BYTES
from surveilnav.storage import TEMPORARY, atomic_write

#: Of payloads and of the folder: 32 hexadecimal digits.
_N_BYTES = 16
_NAME = re.compile(rf"[0-9a-f]{{{2 * _N_BYTES}}}")
_TOKEN_FILE = "token"
#: What nobody has fetched within this time isn't fetched any more.
_OLD_S = 30.0
#: Smaller answers are sent.
MIN_BYTES = 1 << 14


class HandoverFolder:
    """A folder of payloads in memory. Safe from any thread; several processes may use the same folder.

    Attributes:
        token: says which folder it is, whatever its path is here; empty: there is none that can be used.
    """

    def __init__(self, folder: Path | None, max_bytes: int) -> None:
        self._folder, self._max_bytes = folder, max_bytes
        self._lock = threading.Lock()
        self._kept: OrderedDict[str, int] = OrderedDict()  # names and sizes of what this process wrote, oldest first
        self.token = "" if folder is None else _token_of(folder)

    def put(self, payload: bytes) -> str:
        """Leaves a payload for others; returns its name, or "" if that isn't possible."""
        if not self.token or len(payload) > self._max_bytes:
            return ""
        assert self._folder is not None
        if not self._folder.is_dir():  # it was removed, and isn't to be made again
            return ""
        name = _name_of(payload)
        with self._lock:
            is_there = name in self._kept and (self._folder / name).exists()
            self._kept[name] = len(payload)
            self._kept.move_to_end(name)
            try:
                self._make_room()
                if is_there:
                    os.utime(self._folder / name)
                else:
                    with atomic_write(self._folder / name) as file:
                        file.write(payload)
            except OSError:  # the memory is full, or the folder is gone
                self._kept.pop(name, None)
                return ""
        return name

    def get(self, name: str) -> bytes | None:
        """A payload; None if it isn't there (any more), or isn't what its name says."""
        if not self.token or _NAME.fullmatch(name) is None:
            return None
        assert self._folder is not None
        payload = _read(self._folder / name, MAX_MESSAGE_BYTES)
        return payload if payload is not None and _name_of(payload) == name else None

    def clear(self) -> None:
        """Removes every payload from the folder, whoever wrote it."""
        with self._lock:
            self._kept.clear()
            self._remove(lambda age_s: True)

    def remove_old(self) -> None:
        """Removes what lies there for longer than it takes to read it, whoever wrote it."""
        with self._lock:
            self._remove(lambda age_s: abs(age_s) > _OLD_S)  # of the future: the clock was set

    def close(self) -> None:
        """Removes what this process wrote."""
        with self._lock:
            while self._kept:
                self._unlink(self._kept.popitem()[0])

    def _make_room(self) -> None:
        assert self._folder is not None
        while sum(self._kept.values()) > self._max_bytes:
            oldest, _ = self._kept.popitem(last=False)
            self._unlink(oldest)

    def _unlink(self, name: str) -> None:
        assert self._folder is not None
        with suppress(OSError):
            (self._folder / name).unlink()

    def _remove(self, is_meant: Callable[[float], bool]) -> None:
        """Removes payloads by their age [s]."""
        if not self.token:
            return
        assert self._folder is not None
        try:
            paths = list(self._folder.iterdir())
        except OSError:  # the folder is gone
            return
        for path in paths:
            with suppress(OSError):  # somebody else has removed it
                is_payload = _NAME.fullmatch(path.name) or path.suffix == TEMPORARY
                if is_payload and is_meant(time.time() - path.lstat().st_mtime):
                    path.unlink()


def _name_of(payload: bytes) -> str:
    return hashlib.blake2b(payload, digest_size=_N_BYTES).hexdigest()


def _token_of(folder: Path) -> str:
    """The token of a folder, which the first process that uses it writes. "": the folder can't be used, or another user may have
    made it to get what is left in it."""
    path = folder / _TOKEN_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        made_by = folder.lstat()
        if not stat.S_ISDIR(made_by.st_mode) or made_by.st_uid not in (0, os.getuid()):
            return ""
        if not path.exists():
            _write_token(path)
    except OSError:
        return ""
    token = (_read(path, 2 * _N_BYTES) or b"").decode("ascii", "replace")
    return token if _NAME.fullmatch(token) else ""


def _write_token(path: Path) -> None:
    """Writes a token unless another process does so meanwhile."""
    new = path.with_name(f"{_TOKEN_FILE}-{secrets.token_hex(8)}{TEMPORARY}")
    try:
        new.write_text(secrets.token_hex(_N_BYTES))
        with suppress(FileExistsError):
            os.link(new, path)  # unlike a rename, it leaves another's token in place
    finally:
        new.unlink(missing_ok=True)


def _read(path: Path, max_bytes: int) -> bytes | None:
    """A regular file of at most so many bytes; None: there is none. Who writes into the folder may have put anything there."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
        with os.fdopen(handle, "rb") as file:
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode) or status.st_size > max_bytes:
                return None
            return file.read(max_bytes)
    except OSError:
        return None
