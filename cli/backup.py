"""``surveilnav backup`` and ``surveilnav restore``: all stores of a system in one file."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import typer

from surveilnav import __version__
from surveilnav.cli.options import AsJson, console, print_result, results
from surveilnav.errors import ConfigError

File = Annotated[Path, typer.Argument(metavar="FILE", help="The file of the backup.")]
State = Annotated[
    Path, typer.Option(metavar="FOLDER", help="The folder with maps, missions and the robot's place, of all buildings.")
]
Looks = Annotated[
    Path, typer.Option(metavar="FOLDER", help="The folder with the log of who looked at pictures, if it is another.")
]
Recordings = Annotated[
    Path | None, typer.Option(metavar="FOLDER", help="Also the recordings in this folder; else they are left out.")
]
Security = Annotated[
    Path | None,
    typer.Option(
        metavar="FOLDER",
        help="Also this folder of `security init`, with the authority's key and the API keys' hashes; else it is left out.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace what is there already.")]
_STATE, _LOOKS = Path("runs/up/state"), Path("runs/up/looks")


def backup(
    file: File,
    state: State = _STATE,
    looks: Looks = _LOOKS,
    recordings: Recordings = None,
    security: Security = None,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Save all stores of a system into one file, as they are at this moment; the system may run."""
    from surveilnav.cli.backup_archive import ArchiveWriter
    from surveilnav.cli.backup_stores import StoreCopies, is_sqlite, store_files
    from surveilnav.storage import atomic_write

    if file.exists() and not force:
        raise ConfigError(f"{file} exists already: name another file, or replace it with --force")
    folders = {"state": state, "looks": looks, "recordings": recordings, "security": security}
    for name in ("recordings", "security"):
        if (folder := folders[name]) is not None and not folder.is_dir():
            raise ConfigError(f"there is no folder {folder}")
    files = {
        f"{kind}/{path.relative_to(at).as_posix()}": path
        for kind, at in folders.items()
        if at
        for path in store_files(at)
    }
    if not any(name.startswith("state/") for name in files):
        raise ConfigError(f"there are no stores in {state}: name their folder with --state")
    stores = {path for path in files.values() if is_sqlite(path)}
    copies = StoreCopies(sorted(stores))
    try:
        description = _description(files, copies.contents, stores)
        n_bytes = sum(path.stat().st_size for path in files.values())
        with _progress(n_bytes) as on_bytes, tempfile.TemporaryDirectory(dir=_parent(file), prefix=".backup-") as aside:
            # At once, since where the robot stands belongs to the moment that the copies of the stores show.
            small = [path for name, path in files.items() if name.startswith("state/") and path not in stores]
            kept = {path: Path(shutil.copyfile(path, Path(aside, str(k)))) for k, path in enumerate(small)}
            with atomic_write(file) as out:
                archive = ArchiveWriter(out, description)
                for name, path in files.items():
                    mode = path.stat().st_mode
                    if path in stores:
                        copies.copy(path, copy := Path(aside, "store"), on_bytes)
                        archive.add(name, copy, mode, lambda n: None)
                        copy.unlink()
                    else:
                        archive.add(name, kept.get(path, path), mode, on_bytes)
                archive.finish()
                out.flush()
                os.fsync(out.fileno())
    finally:
        copies.close()
    told = {"file": str(file), "bytes": file.stat().st_size, **description}
    print_result(told, as_json, lambda: _show(told, f"saved to {file}"))


def restore(
    file: File,
    state: State = _STATE,
    looks: Looks = _LOOKS,
    recordings: Recordings = None,
    security: Security = None,
    force: Force = False,
    check: Annotated[
        bool, typer.Option("--check", help="Only check the file and say what is in it; restore nothing.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Put back the stores that `backup` has saved, as they were. The system must not run."""
    from surveilnav.cli.backup_archive import open_archive

    folders = {"state": state, "looks": looks, "recordings": recordings, "security": security}
    with open_archive(file) as archive, _progress(file.stat().st_size) as on_bytes:
        if check:
            archive.extract(None, on_bytes)
        else:
            state.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=state, prefix=".restore-") as aside:
                names = archive.extract(Path(aside), on_bytes)
                _put_back(Path(aside), names, folders, force=force)
    told = {"file": str(file), "bytes": file.stat().st_size, **archive.description}
    what = "in it, undamaged" if check else f"restored to {state}"
    print_result(told, as_json, lambda: _show(told, what, folders if not check else None))


def _put_back(aside: Path, names: list[str], folders: dict[str, Path | None], *, force: bool) -> None:
    """Moves extracted files to where they belong, in place of what is there. ConfigError: that isn't allowed."""
    from surveilnav.cli.backup_stores import is_in_use, is_set_aside

    targets: dict[Path, Path] = {}
    for name in names:
        kind, _, rest = name.partition("/")
        if (folder := folders.get(kind)) is not None:
            targets[aside / name] = folder / PurePosixPath(rest)
    # A folder becomes what it was: a newer file that the backup lacks, such as a robot's halt, would not fit the rest.
    former = sorted(
        {p for at in {t.parent for t in targets.values()} if at.is_dir() for p in at.iterdir() if p.is_file()}
    )
    former = [path for path in former if not is_set_aside(path)]
    used = [path for path in former if path.suffix == ".sqlite" and is_in_use(path)]
    if used:
        raise ConfigError(f"a service is using {used[0]}: stop the system first")
    if former and not force:
        raise ConfigError(f"{former[0].parent} has stores already: replace them with --force, or name another folder")
    former = [path for path in former if path.exists()]  # SQLite has removed what it kept beside a store
    moves = [(path, aside / "former" / str(k)) for k, path in enumerate(former)] + list(targets.items())
    done: list[tuple[Path, Path]] = []
    try:
        for source, target in moves:
            target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            done.append((source, target))
            shutil.move(source, target)
    except OSError:
        for source, target in reversed(done):
            if target.exists():
                shutil.move(target, source)
        raise


def _description(
    files: dict[str, Path], contents: Callable[[Path], dict[str, Any]], stores: set[Path]
) -> dict[str, Any]:
    """What is in a backup, for people and programs."""
    rows = []
    for name, path in files.items():
        facts = contents(path) if path in stores else {}
        rows.append({"name": name, "bytes": path.stat().st_size, **facts})
    kinds = {name.partition("/")[0] for name in files}
    return {
        "program": __version__,
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "contents": rows,
        "left_out": [kind for kind in ("recordings", "security") if kind not in kinds],
    }


def _show(told: dict[str, Any], what: str, folders: dict[str, Path | None] | None = None) -> None:
    """Tells people what is in a backup."""
    rows = told.get("contents") or []
    results.print(
        f"{what}: {told['bytes'] / 1e6:,.1f} MB of {told.get('created')}, version {told.get('program')}", markup=False
    )
    for row in rows:
        facts = []
        if "missions" in row:
            facts.append(f"missions: {row['missions']}, {row['missions_open']} of them open")
        if "views" in row:
            facts.append(f"maps; views with their pictures: {row['views']}")
        results.print(f"  {row['name']}{': ' if facts else ''}{'; '.join(facts)}", markup=False, soft_wrap=True)
    for kind in told.get("left_out") or []:
        results.print(f"not in it: {kind} (--{kind} FOLDER)")
    kinds = {str(row["name"]).partition("/")[0] for row in rows}
    for kind in sorted(kinds & {name for name, folder in (folders or {}).items() if folder is None}):
        results.print(f"not restored: {kind} (--{kind} FOLDER)")


@contextmanager
def _progress(n_bytes: int) -> Iterator[Callable[[int], None]]:
    """A function that is told how many bytes were just done, and shows it where that takes time."""
    from surveilnav.cli.progress import bar

    done = 0
    with bar(console) as show:

        def on_bytes(n: int) -> None:
            nonlocal done
            done += n
            show(min(1.0, done / max(1, n_bytes)), f"copying ({done / 1e6:,.0f} of {n_bytes / 1e6:,.0f} MB)")

        yield on_bytes


def _parent(path: Path) -> Path:
    """The folder of a file or folder, made where it is missing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.parent
