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
from contextlib import suppress
from pathlib import Path

from surveilnav.storage import TEMPORARY, atomic_write

_NAME, _TOKEN = re.compile(r"[0-9a-f]{32}"), re.compile(r"[0-9a-f]{32}")
_TOKEN_FILE = "token"
_OLD_S = 30.0
#: Smaller payloads are sent.
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
        name = hashlib.blake2b(payload, digest_size=16).hexdigest()
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
        try:
            payload = (self._folder / name).read_bytes()
        except OSError:
            return None
        return payload if hashlib.blake2b(payload, digest_size=16).hexdigest() == name else None

    def clear(self) -> None:
        """Removes every payload from the folder, whoever wrote it."""
        with self._lock:
            self._kept.clear()
            self._remove(older_than_s=-1.0)

    def remove_old(self) -> None:
        """Removes what lies there for longer than it takes to read it, whoever wrote it."""
        with self._lock:
            self._remove(older_than_s=_OLD_S)

    def _make_room(self) -> None:
        assert self._folder is not None
        while sum(self._kept.values()) > self._max_bytes:
            oldest, _ = self._kept.popitem(last=False)
            (self._folder / oldest).unlink(missing_ok=True)

    def _remove(self, older_than_s: float) -> None:
        if not self.token:
            return
        assert self._folder is not None
        with suppress(OSError):  # the folder is gone, or somebody else removes the same
            for path in list(self._folder.iterdir()):
                is_payload = _NAME.fullmatch(path.name) or path.suffix == TEMPORARY
                if is_payload and time.time() - path.stat().st_mtime > older_than_s:
                    path.unlink(missing_ok=True)


def _token_of(folder: Path) -> str:
    """The token of a folder, which the first process that uses it writes. "": the folder can't be used, or another user may have
    made it to get what is left in it."""
    path = folder / _TOKEN_FILE
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        made_by = folder.lstat()
        if not stat.S_ISDIR(made_by.st_mode) or made_by.st_uid not in (0, os.getuid()):
            return ""
        new = folder / f"{_TOKEN_FILE}-{os.getpid()}-{secrets.token_hex(4)}"
        new.write_text(secrets.token_hex(16))
        try:
            os.link(new, path)  # unlike a rename, it leaves another's token in place
        except FileExistsError:
            pass
        finally:
            new.unlink()
        token = path.read_text()
    except OSError:
        return ""
    return token if _TOKEN.fullmatch(token) else ""
