"""The Sweet Home 3D packages of Debian and Ubuntu: fetched without root, checked, unpacked into the cache.

``apt-get download`` fetches them as any user. Their SHA-256 must be the one in apt's own signed index, or one
of those we know. Only the plans and models are unpacked; nothing is installed, no Java is needed.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import zstandard

from surveilnav.config import cache_dir
from surveilnav.errors import AssetError
from surveilnav.simulator.furniture.catalog import JAR, LIBRARIES
from surveilnav.storage import file_lock

PACKAGES: tuple[str, ...] = ("sweethome3d", "sweethome3d-furniture")

#: SHA-256 of packages that were tried: 7.0.2+dfsg-3 and 1.8-1.
KNOWN_SHA256: frozenset[str] = frozenset(
    {
        "54bce4394ae763da1ffccff8f025565ce7161dc6934371e07480034ef155c411",
        "3ccb90c63f9525e887a767b9cd5c8b6933b8b6b2973a615a5359ee68a2118668",
    }
)

_WANTED = re.compile(r"usr/share/(sweethome3d/.*\.(jar|sh3f)|doc/sweethome3d[^/]*/copyright)")
_MAX_PACKAGE_BYTES = 1 << 30
_TIMEOUT_S = 900

Progress = Callable[[str], None]


def ensure_assets(progress: Progress | None = None, *, cache: Path | None = None) -> Path:
    """The directory with the unpacked packages; fetches them if they aren't there yet.

    Safe to call from several processes at once: one fetches, the others wait.

    Args:
        progress: told what is being done, in a few words.
        cache: the cache directory; default is ``config.cache_dir()``.

    Raises:
        AssetError: they can't be had; the message says what to do.
    """
    base = (cache or cache_dir()) / "assets"
    root = base / "sweethome3d"
    if is_complete(root):
        return root
    say = progress or (lambda _: None)
    try:
        with file_lock(base / ".lock"):
            if is_complete(root):
                return root
            with tempfile.TemporaryDirectory(dir=base, prefix="part-") as part:
                new = _unpacked(base, Path(part), say)
                if root.exists():
                    shutil.rmtree(root)
                os.replace(new, root)
    except OSError as error:
        raise AssetError(
            f"the furniture can't be kept in {base} ({error}): free some space (400 MB) or set SURVEILNAV_CACHE_DIR"
        ) from error
    return root


def is_here(cache: Path | None = None) -> bool:
    """Whether the packages lie in the cache, so that ``ensure_assets`` fetches nothing."""
    return is_complete((cache or cache_dir()) / "assets" / "sweethome3d")


def _unpacked(base: Path, part: Path, say: Progress) -> Path:
    """A new directory in ``part`` with the contents of all packages."""
    new = part / "root"
    for package in PACKAGES:
        deb, trusted = _package_file(package, base, part, say)
        _check(deb, package, trusted)
        say(f"unpacking {package}")
        unpack_deb(deb, new)
    if not is_complete(new):
        raise AssetError(f"the packages {', '.join(PACKAGES)} lack {JAR} or {LIBRARIES}/*.sh3f: a version we can't use")
    return new


def is_complete(root: Path) -> bool:
    """Whether plans and libraries lie there."""
    return (root / JAR).is_file() and any((root / LIBRARIES).glob("*.sh3f"))


def _package_file(package: str, base: Path, part: Path, say: Progress) -> tuple[Path, frozenset[str]]:
    """The package's file, and the hashes that apt's index gives it."""
    by_hand = sorted(base.glob(f"{package}_*.deb"))
    trusted = _index_hashes(package) if shutil.which("apt-cache") else frozenset()
    if by_hand:
        return by_hand[-1], trusted
    remedy = (
        f"get the packages {' and '.join(PACKAGES)} from a Debian or Ubuntu archive and put both .deb files "
        f"into {base}; or use a home that needs none: parametric_flat, parametric_house"
    )
    if not shutil.which("apt-get"):
        raise AssetError(
            f"example homes and furniture come from Debian packages, and there is no apt-get here: {remedy}"
        )
    if not trusted:
        raise AssetError(
            f"apt knows no package {package!r}: run `apt-get update` as root "
            f"(on Ubuntu, with 'universe' enabled); or {remedy}"
        )
    say(f"downloading {package} (apt-get download)")
    return _downloaded(package, part, remedy), trusted


def _downloaded(package: str, part: Path, remedy: str) -> Path:
    """The package's file, which apt-get puts into ``part``."""
    command = ["apt-get", "download", "-q", package]
    try:
        done = _run(command, _TIMEOUT_S, cwd=part)
    except subprocess.TimeoutExpired as error:
        raise AssetError(f"`{' '.join(command)}` took more than {_TIMEOUT_S} s: try again; or {remedy}") from error
    found = sorted(part.glob(f"{package}_*.deb"))
    if done.returncode != 0 or not found:
        reason = " ".join((done.stderr or done.stdout).split())[-300:]
        raise AssetError(
            f"`{' '.join(command)}` failed ({reason}): "
            f"is the network there, are apt's lists fresh (`apt-get update`)? Or {remedy}"
        )
    return found[-1]


def _run(command: list[str], timeout_s: float, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Runs a command of apt's, whose words are to be English."""
    return subprocess.run(
        command,
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=timeout_s,
        env={**os.environ, "LC_ALL": "C"},
        check=False,
    )


def _index_hashes(package: str) -> frozenset[str]:
    """All SHA-256 that apt's index has for a package."""
    try:
        done = _run(["apt-cache", "show", package], 60)
    except (OSError, subprocess.TimeoutExpired):
        return frozenset()
    return frozenset(re.findall(r"^SHA256:\s*([0-9a-f]{64})\s*$", done.stdout, re.MULTILINE))


def _check(deb: Path, package: str, trusted: frozenset[str]) -> None:
    with deb.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found not in trusted | KNOWN_SHA256:
        raise AssetError(
            f"{deb.name} isn't the {package} that apt's index names: expected SHA-256 "
            f"{' or '.join(sorted(trusted | KNOWN_SHA256))}, got {found}; delete it and try again"
        )


def unpack_deb(deb: Path, target: Path) -> None:
    """Unpacks plans, models and copyright notes of a Debian package (an ``ar`` archive with a tar in it).

    Raises:
        AssetError: it is damaged.
    """
    try:
        with _data_tar(deb) as data:
            for member in data:
                name = member.name.removeprefix("./")
                if not member.isfile() or ".." in Path(name).parts or not _WANTED.fullmatch(name):
                    continue
                source = data.extractfile(member)
                if source is None:
                    continue
                path = target / name
                path.parent.mkdir(parents=True, exist_ok=True)
                with path.open("wb") as file:
                    shutil.copyfileobj(source, file, 1 << 20)
    except (tarfile.TarError, EOFError, ValueError, zstandard.ZstdError) as error:
        raise AssetError(f"{deb} is damaged ({error}): delete it and try again") from error


@contextmanager
def _data_tar(deb: Path) -> Iterator[tarfile.TarFile]:
    """The ``data.tar.*`` of a package (deb(5))."""
    with deb.open("rb") as file:
        if file.read(8) != b"!<arch>\n":
            raise ValueError("no ar archive")
        while header := file.read(60):
            if len(header) < 60 or header[58:] != b"`\n":
                raise ValueError("an ar header is broken")
            name, size = header[:16].decode("ascii", "replace").strip().rstrip("/"), int(header[48:58])
            if name.startswith("data.tar"):
                if size > _MAX_PACKAGE_BYTES:
                    raise ValueError("larger than 1 GiB")
                raw = file.read(size)
                if len(raw) < size:
                    raise ValueError("cut short")
                with _opened_tar(raw, packed=name.endswith(".zst")) as data:
                    yield data
                return
            file.seek(size + size % 2, os.SEEK_CUR)
    raise ValueError("it has no data.tar")


@contextmanager
def _opened_tar(raw: bytes, *, packed: bool) -> Iterator[tarfile.TarFile]:
    if packed:  # by Zstandard, which tarfile doesn't know
        stream = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(raw))
        with stream, tarfile.open(fileobj=stream, mode="r|") as data:
            yield data
    else:
        with tarfile.open(fileobj=io.BytesIO(raw), mode="r:*") as data:
            yield data


def main() -> int:
    """``python -m surveilnav.simulator.furniture.assets``: the set-up step."""
    try:
        root = ensure_assets(lambda what: print(f"furniture: {what}", file=sys.stderr))
    except AssetError as error:
        print(f"furniture: {error}", file=sys.stderr)
        return 1
    print(f"furniture: {root}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
