"""The records of a run: a folder with its settings and a table, one row a search.

``settings.json`` says what the run is: version, dataset, program, settings. ``searches.csv`` is the table: while a run is
being played it grows row by row and survives a kill at any moment; when all is played its rows are put in the dataset's
order, and the folder can be published as it is. ``broken.jsonl`` names searches that the program failed on.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from surveilnav.benchmark import journal
from surveilnav.benchmark.runner.basis import Basis
from surveilnav.benchmark.runner.row import HEADER, OLD_HEADER, EpisodeRecord, key_of_row, record_of_row, row_of
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.errors import ConfigError
from surveilnav.perception import models
from surveilnav.perception.names import BackendName

VERSION = 5
#: The version before, which is still read. Its rows don't say what a search's loss is explained by, so no run goes on in it.
OLD_VERSION = 4
SETTINGS_FILE, SEARCHES_FILE, BROKEN_FILE = "settings.json", "searches.csv", "broken.jsonl"
_MOVE_AWAY = "move it away and run again: the searches are then played anew"


class Broken(msgspec.Struct, frozen=True, kw_only=True):
    """A search that the program failed on: never counted, always named, tried again by the next run."""

    scene: str
    episode_id: str
    error: str


class Records:
    """A run's folder. Safe for several processes at once.

    Raises (all methods):
        ConfigError: a file is damaged, of another run, or the disk is full; the message says what to do.
    """

    def __init__(self, folder: Path, settings: RunSettings, basis: Basis) -> None:
        """Settings and basis are kept, so runs can't be mixed; a folder without a search takes any."""
        self.folder, self.path = folder, folder / SEARCHES_FILE
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"{folder} can't be made a folder for a run: {error.strerror}") from error
        with _using(folder), journal.locked(self.path):
            there = read_facts(folder)
            if not self.path.exists() or not _rows(folder):
                journal.rewrite(self.path, [HEADER])
            if there is not None and there.get("version") == VERSION and _are(there, settings, basis):
                return
            if _rows(folder):
                difference = _difference(there, settings, basis)
                raise ConfigError(
                    f"{folder} holds another run ({difference}): take another --out, or delete that folder to play it anew"
                )
            (folder / BROKEN_FILE).unlink(missing_ok=True)
            write_facts(folder, facts_of(settings, basis))

    def add(self, record: EpisodeRecord) -> None:
        """Keeps a search; when this returns, a kill can't lose it."""
        with _using(self.folder):
            journal.append(self.path, row_of(record))

    def add_broken(self, broken: Broken) -> None:
        """Names a search that the program failed on."""
        with _using(self.folder):
            journal.append(self.folder / BROKEN_FILE, msgspec.json.encode(broken).decode())

    def forget_damaged(self) -> list[tuple[str, str]]:
        """Removes rows that can't be read, so that their searches are played again. Returns the keys of these searches."""
        sound, damaged = [], []
        with _using(self.folder), journal.locked(self.path):
            for row in _rows(self.folder):
                try:
                    record_of_row(row)
                    sound.append(row)
                except ValueError:
                    damaged.append(key_of_row(row))
            if damaged:
                journal.rewrite(self.path, [HEADER, *sound])
        return sorted(damaged)

    def sort(self) -> None:
        """Sorts the rows by the dataset's order and removes duplicates, so that the same run always makes the same file."""
        with _using(self.folder), journal.locked(self.path):
            settled = [row_of(r) for r in read(self.folder)]
            if settled != _rows(self.folder):
                journal.rewrite(self.path, [HEADER, *settled])
            if not _broken(self.folder):
                (self.folder / BROKEN_FILE).unlink(missing_ok=True)

    def done(self) -> set[tuple[str, str]]:
        """The keys of what is there."""
        with _using(self.folder):
            return {key_of_row(row) for row in _rows(self.folder)}

    def all(self) -> list[EpisodeRecord]:
        """All searches, in the dataset's order."""
        return read(self.folder)

    def broken(self) -> list[Broken]:
        """What the program failed on and hasn't played since."""
        return _broken(self.folder)


class StoredRun(NamedTuple):
    """The searches of a run that its folder holds, and those that the program failed on."""

    records: list[EpisodeRecord]
    broken: list[Broken]


def stored_run(folder: Path, settings: RunSettings, basis: Basis) -> StoredRun | None:
    """Reads what was played of exactly this run, without changing the folder. None: it holds nothing, or another run.

    Raises:
        ConfigError: a file is damaged.
    """
    there = read_facts(folder)
    if there is None or not (folder / SEARCHES_FILE).exists() or not _are(there, settings, basis):
        return None
    return StoredRun(read(folder), _broken(folder))


def read(folder: Path) -> list[EpisodeRecord]:
    """All searches in a run's folder, whatever program and dataset they were played with, in the dataset's order.

    Raises:
        ConfigError: there is no such run, it is damaged, or of another version.
    """
    path = folder / SEARCHES_FILE
    facts = read_facts(folder)
    if facts is None or not path.exists():
        raise ConfigError(f"{folder} holds no run: expected the files {SETTINGS_FILE} and {SEARCHES_FILE}")
    if (version := facts.get("version")) not in (VERSION, OLD_VERSION):
        raise ConfigError(f"{path} is of version {version}, expected {VERSION}: read it with the program that wrote it")
    try:
        with _using(folder):
            by_key = {record.key: record for record in map(record_of_row, _rows(folder))}  # of equals the last
    except ValueError as error:
        raise ConfigError(
            f"{path} holds a row that can't be read ({error}): a run into this folder plays that search anew"
        ) from error
    return [by_key[key] for key in sorted(by_key, key=lambda key: (key[0], int(key[1])))]


# --- which run it is ----------------------------------------------------------------------------------------------


def facts_of(settings: RunSettings, basis: Basis) -> dict[str, Any]:
    """What makes a run this run, as ``settings.json`` says it."""
    return {"version": VERSION, **basis._asdict(), **_weights(settings), "settings": msgspec.to_builtins(settings)}


def _weights(settings: RunSettings) -> dict[str, str]:
    """Which weights look, where new ones come under the old name: those of the package. PerceptionError: they are gone."""
    name = settings.perception
    return {"weights": models.model_id(name, models.find(name, download=False))} if name == BackendName.COMPACT else {}


def read_facts(folder: Path) -> dict[str, Any] | None:
    """What ``settings.json`` says; None: there is none. ConfigError: it can't be read."""
    path = folder / SETTINGS_FILE
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, Any])
    except FileNotFoundError:
        return None
    except (OSError, msgspec.DecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} doesn't say of which run it is ({error}): {_MOVE_AWAY}") from error


def write_facts(folder: Path, facts: dict[str, Any]) -> None:
    """Writes ``settings.json``. OSError: as the disk does."""
    text = msgspec.json.format(msgspec.json.encode(facts), indent=1).decode()
    # lists on one line
    journal.rewrite(folder / SETTINGS_FILE, [re.sub(r"\[\s+([^\[\]{}]*?)\s+\]", lambda m: f"[{m[1]}]", text)])


def _are(facts: dict[str, Any], settings: RunSettings, basis: Basis) -> bool:
    """Whether facts are those of this run, in any version that is read; a setting that they don't say yet has its default."""
    try:
        said = msgspec.convert(facts.get("settings"), RunSettings)
    except msgspec.ValidationError:
        return False
    version = {"version": facts.get("version") if facts.get("version") == OLD_VERSION else VERSION}
    return facts | {"settings": said} == facts_of(settings, basis) | {"settings": settings} | version


def _difference(there: dict[str, Any] | None, settings: RunSettings, basis: Basis) -> str:
    """What a person would want to know of two runs' facts."""
    kept, asked = there or {}, facts_of(settings, basis)
    if kept.get("version") != asked["version"]:
        return f"its records are of version {kept.get('version')}"
    if kept.get("dataset") != asked["dataset"]:
        return "on another dataset"
    if kept.get("program") != asked["program"]:
        return "by a program that searches otherwise"
    if kept.get("weights") != asked.get("weights"):
        return f"seen with {kept.get('weights')}, now there is {asked.get('weights')}"
    was, now = kept.get("settings"), asked["settings"]
    if not isinstance(was, dict):
        return "of which the settings aren't said"
    if unknown := sorted(was.keys() - now.keys()):
        return f"it has a setting {unknown[0]!r} that there isn't"
    return ", ".join(f"{k} {was[k]!r}, asked {v!r}" for k, v in now.items() if k in was and was[k] != v)


# --- files --------------------------------------------------------------------------------------------------------


def _rows(folder: Path) -> Sequence[str]:
    """The table without its header. ConfigError: it has none. OSError."""
    path = folder / SEARCHES_FILE
    header, *rows = journal.lines(path) or [""]
    if header not in (HEADER, OLD_HEADER):
        raise ConfigError(f"{path} is damaged: its first line is {header[:40]!r}, expected {HEADER!r}; {_MOVE_AWAY}")
    return rows


def _broken(folder: Path) -> list[Broken]:
    path = folder / BROKEN_FILE
    if not path.exists():
        return []
    try:
        with _using(folder):
            done = {key_of_row(row) for row in _rows(folder)}
            named = [msgspec.json.decode(line, type=Broken) for line in journal.lines(path)]
    except msgspec.DecodeError as error:
        raise ConfigError(f"{path} is damaged: {error}; {_MOVE_AWAY}") from error
    latest = {(b.scene, b.episode_id): b for b in named}
    return [latest[key] for key in sorted(latest.keys() - done)]


@contextmanager
def _using(folder: Path) -> Iterator[None]:
    """Says for people what the disk refuses."""
    try:
        yield
    except OSError as error:
        raise ConfigError(f"{folder} can't be used: {error}; is the disk full or read-only?") from error
