"""One file from an address: resumed where it broke off, checked, and only then given its name."""

from __future__ import annotations

import errno
import hashlib
import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import httpx

from surveilnav.errors import PerceptionError
from surveilnav.perception.models import digest

#: Is told bytes so far, bytes in all (None: unknown), and the file's name.
OnProgress = Callable[[int, int | None, str], None]

_TIMEOUT = httpx.Timeout(60.0, connect=5.0)
_ATTEMPTS = 5  # of one transfer, as long as each gets further
_ROOM_BYTES = 1_000_000  # left free on the disk


@dataclass(frozen=True, slots=True)
class Wanted:
    """What to fetch. ``n_bytes``, ``sha256``: what it must be, None where nobody knows yet."""

    url: str
    path: Path
    n_bytes: int | None = None
    sha256: str | None = None

    @property
    def part(self) -> Path:
        """Where it lies until it is whole."""
        return self.path.with_name(self.path.name + ".part")

    @property
    def note(self) -> Path:
        """Which version of the file the part is of: the server's ETag."""
        return self.path.with_name(self.path.name + ".part.etag")

    def begun_bytes(self) -> int:
        """How much of it is there, in bytes."""
        return self.part.stat().st_size if self.part.is_file() else 0

    def forget(self) -> None:
        """Removes what was begun."""
        self.part.unlink(missing_ok=True)
        self.note.unlink(missing_ok=True)


@dataclass(slots=True)
class Said:
    """What a server said of a file. ``commit``: of the hub's repository; ``sha256``: the hub's own word."""

    total_bytes: int | None = None
    commit: str = ""
    sha256: str | None = None


def transfer(wanted: Wanted, on_progress: OnProgress | None = None) -> tuple[str, Said]:
    """Fetches a file; returns its sha256 and what the server said.

    A transfer that breaks off leaves ``.part``, and the next one goes on from there if the file is still the same.

    Raises:
        PerceptionError: it can't be had, there is no room for it, or it is another file than expected.
        FileNotFoundError: the server has no such file.
    """
    said = Said(wanted.n_bytes)
    try:
        if wanted.n_bytes is None or wanted.begun_bytes() != wanted.n_bytes:
            said = _receive_all(wanted, on_progress)
        return _accept(wanted, said), said
    except FileNotFoundError:
        raise
    except OSError as error:
        raise _cannot_write(wanted, error) from error


def _receive_all(wanted: Wanted, on_progress: OnProgress | None) -> Said:
    """Receives until the end, over as many connections as get further."""
    for attempt in range(_ATTEMPTS):
        before = wanted.begun_bytes()
        try:
            return _receive(wanted, on_progress)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            broke_off = isinstance(error, httpx.TransportError) and wanted.begun_bytes() > before
            if not broke_off or attempt == _ATTEMPTS - 1:
                raise _not_had(wanted, error) from error
    raise AssertionError("the last attempt returns or raises")


def _receive(wanted: Wanted, on_progress: OnProgress | None) -> Said:
    """Receives what is missing, over one connection."""
    begin = wanted.begun_bytes()
    with httpx.stream("GET", wanted.url, headers=_headers(wanted), timeout=_TIMEOUT, follow_redirects=True) as answer:
        said = _said(answer)
        if answer.status_code == 404:
            raise FileNotFoundError(errno.ENOENT, "the server has no such file", wanted.url)
        if answer.status_code == 416:  # nothing is left to send, or the file is another by now
            if said.total_bytes != begin:
                wanted.forget()
                raise httpx.ReadError("the file has changed since the transfer began")
            return said
        answer.raise_for_status()
        if answer.status_code != 206 or not _goes_on_at(answer, begin):
            wanted.forget()
        _write(wanted, answer, said, on_progress)
    return said


def _headers(wanted: Wanted) -> dict[str, str]:
    """Asks for the rest of what was begun, if it is of the same version. Never compressed: sizes must be the file's."""
    headers = {"Accept-Encoding": "identity"}
    begin = wanted.begun_bytes()
    tag = wanted.note.read_text().strip() if wanted.note.is_file() else ""
    if begin and (tag or wanted.sha256):
        headers["Range"] = f"bytes={begin}-"
        if tag:
            headers["If-Range"] = tag
    return headers


def _goes_on_at(answer: httpx.Response, begin: int) -> bool:
    match = re.match(r"bytes (\d+)-", answer.headers.get("content-range", ""))
    return match is not None and int(match[1]) == begin


def _said(answer: httpx.Response) -> Said:
    """Reads the headers of an answer and of the redirects to it."""
    said = Said()
    for each in (*answer.history, answer):
        said.commit = said.commit or each.headers.get("x-repo-commit", "")
        linked = each.headers.get("x-linked-etag", "").strip('W/"')
        said.sha256 = said.sha256 or (linked if re.fullmatch(r"[0-9a-f]{64}", linked) else None)
    total = re.search(r"/(\d+)$", answer.headers.get("content-range", ""))
    plain = answer.status_code == 200 and "content-encoding" not in answer.headers
    length = total[1] if total else answer.headers.get("content-length", "") if plain else ""
    said.total_bytes = int(length) if length.isdigit() else None
    return said


def _write(wanted: Wanted, answer: httpx.Response, said: Said, on_progress: OnProgress | None) -> None:
    """Appends an answer's content to the part. PerceptionError: there is no room for it."""
    wanted.path.parent.mkdir(parents=True, exist_ok=True)
    done = wanted.begun_bytes()
    total = wanted.n_bytes or said.total_bytes
    _expect_room(wanted, (total or done) - done)
    tag = answer.headers.get("etag", "")
    if tag and not tag.startswith("W/"):  # a weak one can't vouch for bytes
        wanted.note.write_text(tag)
    with wanted.part.open("ab") as out:
        for chunk in answer.iter_bytes():
            out.write(chunk)
            done += len(chunk)
            if wanted.n_bytes is not None and done > wanted.n_bytes:
                break
            if on_progress is not None:
                on_progress(done, total, wanted.path.name)


def _accept(wanted: Wanted, said: Said) -> str:
    """Gives the part its name if it is what it should be; returns its sha256."""
    found_bytes, expected_bytes = wanted.begun_bytes(), wanted.n_bytes or said.total_bytes
    with wanted.part.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    expected = wanted.sha256 or said.sha256
    if expected is None and expected_bytes is None:
        wanted.forget()
        raise PerceptionError(
            f"{wanted.url} doesn't say how long the file is, so half of it would look like all of it. Not used. "
            "Get the file elsewhere, and put it into SURVEILNAV_MODELS_DIR."
        )
    if found_bytes != (expected_bytes or found_bytes) or found != (expected or found):
        wanted.forget()
        raise PerceptionError(
            f"{wanted.url} holds another file than expected: {found_bytes:,} bytes with sha256 {found[:12]}, not "
            f"{f'{expected_bytes:,}' if expected_bytes else 'that many'} with {(expected or found)[:12]}. Not used. "
            "Try again; if it stays so, get the file elsewhere and put it into SURVEILNAV_MODELS_DIR."
        )
    wanted.part.replace(wanted.path)
    digest.remember(wanted.path, found)
    wanted.note.unlink(missing_ok=True)
    return found


def _expect_room(wanted: Wanted, missing_bytes: int) -> None:
    free_bytes = shutil.disk_usage(wanted.path.parent).free
    if missing_bytes + _ROOM_BYTES > free_bytes:
        raise PerceptionError(
            f"no room for {wanted.path.name}: {missing_bytes / 1e6:,.0f} MB are to come, {wanted.path.parent} has "
            f"{free_bytes / 1e6:,.0f} MB left. Make room, or set SURVEILNAV_CACHE_DIR to a larger disk."
        )


def _cannot_write(wanted: Wanted, error: OSError) -> PerceptionError:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return PerceptionError(
            f"no room for {wanted.path.name} in {wanted.path.parent}. Make room, or set SURVEILNAV_CACHE_DIR to "
            "a larger disk; the next pull goes on from what is there."
        )
    return PerceptionError(
        f"{wanted.path.name} can't be written into {wanted.path.parent} ({error.strerror}). Set SURVEILNAV_CACHE_DIR "
        "to a folder you can write, or point SURVEILNAV_MODELS_DIR at a folder that has it."
    )


def _not_had(wanted: Wanted, error: httpx.HTTPError | httpx.InvalidURL) -> PerceptionError:
    begun = wanted.begun_bytes()
    why = f"{type(error).__name__}: {error}"
    if isinstance(error, httpx.HTTPStatusError):
        why = f"HTTP {error.response.status_code}"
    kept = f" {begun / 1e6:,.1f} MB are kept: the next pull goes on from there." if begun else ""
    return PerceptionError(
        f"{wanted.path.name} isn't on this machine and can't be downloaded from {wanted.url} "
        f"({why}).{kept} "
        "Or put it into a folder and point SURVEILNAV_MODELS_DIR at that."
    )
