"""Downloads one file: resumes an interrupted transfer, checks the content, and only then gives the file its name.

Why this isn't huggingface_hub or pooch: docs/understand/adr/0011.
"""

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
from surveilnav.perception.models import hashes

#: Is called with the bytes so far, the bytes in all (None: unknown), and the file's name.
OnProgress = Callable[[int, int | None, str], None]

_TIMEOUT = httpx.Timeout(60.0, connect=5.0)
_ATTEMPTS = 5  # connections of one transfer, as long as each brings some bytes
_ROOM_BYTES = 1_000_000  # left free on the disk


@dataclass(frozen=True, slots=True)
class Download:
    """A file to download, and where to. ``n_bytes`` and ``sha256`` are what it must have; None where that isn't known yet."""

    url: str
    path: Path
    n_bytes: int | None = None
    sha256: str | None = None

    @property
    def part(self) -> Path:
        """The file that has what was received so far."""
        return self.path.with_name(self.path.name + ".part")

    @property
    def etag_file(self) -> Path:
        """The file that says of which version the part is: the server's ETag."""
        return self.path.with_name(self.path.name + ".part.etag")

    def begun_bytes(self) -> int:
        return self.part.stat().st_size if self.part.is_file() else 0

    def discard(self) -> None:
        self.part.unlink(missing_ok=True)
        self.etag_file.unlink(missing_ok=True)


@dataclass(slots=True)
class RemoteFile:
    """What a server's headers say of a file. ``commit``: of the hub's repository; ``sha256``: as the hub names it."""

    total_bytes: int | None = None
    commit: str = ""
    sha256: str | None = None


def transfer(download: Download, on_progress: OnProgress | None = None) -> tuple[str, RemoteFile]:
    """Downloads a file; returns its sha256 and what the server said of it.

    An interrupted transfer leaves ``.part``, and the next one resumes it if the server still has the same file.

    Raises:
        PerceptionError: it can't be downloaded, there is no room for it, or it is another file than expected.
        FileNotFoundError: the server has no such file.
    """
    remote = RemoteFile(download.n_bytes)
    try:
        if download.n_bytes is None or download.begun_bytes() != download.n_bytes:
            remote = _receive_all(download, on_progress)
        return _accept(download, remote), remote
    except FileNotFoundError:
        raise
    except OSError as error:
        raise _cannot_write(download, error) from error


def _receive_all(download: Download, on_progress: OnProgress | None) -> RemoteFile:
    """Receives the file to its end. A connection that breaks is followed by another as long as each brings some bytes."""
    for attempt in range(_ATTEMPTS):
        before = download.begun_bytes()
        try:
            return _receive(download, on_progress)
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            broke_off = isinstance(error, httpx.TransportError) and download.begun_bytes() > before
            if not broke_off or attempt == _ATTEMPTS - 1:
                raise _not_had(download, error) from error
    raise AssertionError("the last attempt returns or raises")


def _receive(download: Download, on_progress: OnProgress | None) -> RemoteFile:
    """Receives the missing bytes over one connection."""
    begin = download.begun_bytes()
    with httpx.stream(
        "GET", download.url, headers=_headers(download), timeout=_TIMEOUT, follow_redirects=True
    ) as answer:
        remote = _remote_file(answer)
        if answer.status_code == 404:
            raise FileNotFoundError(errno.ENOENT, "the server has no such file", download.url)
        if answer.status_code == 416:  # nothing is left to send, or the server has another file by now
            if remote.total_bytes != begin:
                download.discard()
                raise httpx.ReadError("the file has changed since the transfer began")
            return remote
        answer.raise_for_status()
        if answer.status_code != 206 or not _goes_on_at(answer, begin):
            download.discard()
        _write(download, answer, remote, on_progress)
    return remote


def _headers(download: Download) -> dict[str, str]:
    """Headers that ask for the missing bytes of the same version, never compressed: sizes must be the file's."""
    headers = {"Accept-Encoding": "identity"}
    begin = download.begun_bytes()
    tag = download.etag_file.read_text().strip() if download.etag_file.is_file() else ""
    if begin and (tag or download.sha256):
        headers["Range"] = f"bytes={begin}-"
        if tag:
            headers["If-Range"] = tag
    return headers


def _goes_on_at(answer: httpx.Response, begin: int) -> bool:
    match = re.match(r"bytes (\d+)-", answer.headers.get("content-range", ""))
    return match is not None and int(match[1]) == begin


def _remote_file(answer: httpx.Response) -> RemoteFile:
    """What the headers of an answer, and of the redirects to it, say of the file."""
    remote = RemoteFile()
    for each in (*answer.history, answer):
        remote.commit = remote.commit or each.headers.get("x-repo-commit", "")
        linked = each.headers.get("x-linked-etag", "").strip('W/"')
        remote.sha256 = remote.sha256 or (linked if re.fullmatch(r"[0-9a-f]{64}", linked) else None)
    total = re.search(r"/(\d+)$", answer.headers.get("content-range", ""))
    plain = answer.status_code == 200 and "content-encoding" not in answer.headers
    length = total[1] if total else answer.headers.get("content-length", "") if plain else ""
    remote.total_bytes = int(length) if length.isdigit() else None
    return remote


def _write(download: Download, answer: httpx.Response, remote: RemoteFile, on_progress: OnProgress | None) -> None:
    """Appends the content of an answer to the part. PerceptionError: there is no room for it."""
    download.path.parent.mkdir(parents=True, exist_ok=True)
    done = download.begun_bytes()
    total = download.n_bytes or remote.total_bytes
    _expect_room(download, (total or done) - done)
    tag = answer.headers.get("etag", "")
    if tag and not tag.startswith("W/"):  # a weak ETag doesn't promise the same bytes
        download.etag_file.write_text(tag)
    with download.part.open("ab") as out:
        for chunk in answer.iter_bytes():
            out.write(chunk)
            done += len(chunk)
            if download.n_bytes is not None and done > download.n_bytes:
                break
            if on_progress is not None:
                on_progress(done, total, download.path.name)


def _accept(download: Download, remote: RemoteFile) -> str:
    """Checks the part, gives it the file's name, and returns its sha256. PerceptionError: it is another file than expected."""
    found_bytes, expected_bytes = download.begun_bytes(), download.n_bytes or remote.total_bytes
    with download.part.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    expected = download.sha256 or remote.sha256
    if expected is None and expected_bytes is None:
        download.discard()
        raise PerceptionError(
            f"{download.url} doesn't say how long the file is, so half of it would look like all of it. Not used. "
            "Get the file elsewhere, and put it into SURVEILNAV_MODELS_DIR."
        )
    if found_bytes != (expected_bytes or found_bytes) or found != (expected or found):
        download.discard()
        raise PerceptionError(
            f"{download.url} holds another file than expected: {found_bytes:,} bytes with sha256 {found[:12]}, not "
            f"{f'{expected_bytes:,}' if expected_bytes else 'that many'} with {(expected or found)[:12]}. Not used. "
            "Try again; if it stays so, get the file elsewhere and put it into SURVEILNAV_MODELS_DIR."
        )
    download.part.replace(download.path)
    hashes.remember(download.path, found)
    download.etag_file.unlink(missing_ok=True)
    return found


def _expect_room(download: Download, missing_bytes: int) -> None:
    free_bytes = shutil.disk_usage(download.path.parent).free
    if missing_bytes + _ROOM_BYTES > free_bytes:
        raise PerceptionError(
            f"no room for {download.path.name}: {missing_bytes / 1e6:,.0f} MB are to come, {download.path.parent} has "
            f"{free_bytes / 1e6:,.0f} MB left. Make room, or set SURVEILNAV_CACHE_DIR to a larger disk."
        )


def _cannot_write(download: Download, error: OSError) -> PerceptionError:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return PerceptionError(
            f"no room for {download.path.name} in {download.path.parent}. Make room, or set SURVEILNAV_CACHE_DIR to "
            "a larger disk; the next pull goes on from what is there."
        )
    return PerceptionError(
        f"{download.path.name} can't be written into {download.path.parent} ({error.strerror}). Set SURVEILNAV_CACHE_DIR "
        "to a folder you can write, or point SURVEILNAV_MODELS_DIR at a folder that has it."
    )


def _not_had(download: Download, error: httpx.HTTPError | httpx.InvalidURL) -> PerceptionError:
    begun = download.begun_bytes()
    why = f"{type(error).__name__}: {error}"
    if isinstance(error, httpx.HTTPStatusError):
        why = f"HTTP {error.response.status_code}"
    kept = f" {begun / 1e6:,.1f} MB are kept: the next pull goes on from there." if begun else ""
    return PerceptionError(
        f"{download.path.name} isn't on this machine and can't be downloaded from {download.url} "
        f"({why}).{kept} "
        "Or put it into a folder and point SURVEILNAV_MODELS_DIR at that."
    )
