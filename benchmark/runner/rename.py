"""Published runs after a setting was renamed: the same runs under the settings' new names.

    python -m surveilnav.benchmark.runner.rename fusion.objects.tau=fusion.objects.association.tau [OLD=NEW ...]
        [--value fusion.objects.association.tau:1.1=null ...] [--records FOLDER]

A run's folder is named by its settings (``run_id``), and ``settings.json`` in it says them in full. Whoever renames a
setting, or moves it, or says a value of it in another way, runs this once in the same commit: it mends every
``settings.json`` and gives the folders their new names. Without arguments it only does the latter, as after a default that
changed. Searches aren't touched.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from surveilnav.benchmark.runner.records import read_facts, write_facts
from surveilnav.benchmark.runner.settings import RunSettings, run_id
from surveilnav.errors import ConfigError

PUBLISHED = Path("docs/results/bench/records")


class Value(NamedTuple):
    """A setting's value that is now said in another way; ``name`` is the setting's new one."""

    name: str
    was: Any
    now: Any


def rename(records: Path, names: Mapping[str, str], values: Sequence[Value] = ()) -> list[tuple[str, str]]:
    """Renames settings in all runs of a folder; dots lead into nested ones. Returns (old, new) names of the folders.

    Raises:
        ConfigError: settings that don't exist under their new names, or two runs that come to the same; then nothing
            was changed.
    """
    planned: list[tuple[Path, Path, dict[str, Any]]] = []
    for folder in sorted(p for p in records.iterdir() if p.is_dir()):
        facts = read_facts(folder)
        if facts is None:
            raise ConfigError(f"{folder} holds no run: move it away")
        settings = facts["settings"]
        for old, new in names.items():
            _move(settings, old.split("."), new.split("."))
        for value in values:
            _revalue(settings, value)
        try:
            named = records / run_id(msgspec.convert(settings, RunSettings))
        except msgspec.ValidationError as error:
            raise ConfigError(f"{folder}: such settings can't be: {error}") from error
        planned.append((folder, named, facts))
    targets = [named for _, named, _ in planned]
    if twice := sorted({t.name for t in targets if targets.count(t) > 1}):
        raise ConfigError(f"two runs come to {twice[0]}: are they to be told apart by a setting of another name?")
    moved = [(folder, named) for folder, named, _ in planned if folder != named]
    for folder, _, facts in planned:
        write_facts(folder, facts)
    for folder, named in moved:  # two steps: a new name may be another run's old one
        folder.rename(named.with_name(f".{named.name}"))
    for _, named in moved:
        named.with_name(f".{named.name}").rename(named)
    return [(folder.name, named.name) for folder, named in moved]


def _move(settings: dict[str, Any], old: Sequence[str], new: Sequence[str]) -> None:
    """Moves a value to another place, if there is one; what it leaves empty goes."""
    above = [settings]
    for name in old[:-1]:
        if not isinstance(inner := above[-1].get(name), dict):
            return
        above.append(inner)
    if old[-1] not in above[-1]:
        return
    value = above[-1].pop(old[-1])
    for name, outer, inner in reversed(list(zip(old, above, above[1:], strict=False))):
        if not inner and outer is not settings:
            del outer[name]
    place = settings
    for name in new[:-1]:
        place = place.setdefault(name, {})
    place[new[-1]] = value


def _revalue(settings: dict[str, Any], value: Value) -> None:
    *above, last = value.name.split(".")
    for name in above:
        settings = inner if isinstance(inner := settings.get(name), dict) else {}
    if last in settings and settings[last] == value.was:
        settings[last] = value.now


def _value_of(text: str) -> Value:
    """Of NAME:OLD=NEW, both JSON. ValueError: it isn't so."""
    name, _, both = text.partition(":")
    was, now = both.split("=")
    return Value(name, json.loads(was), json.loads(now))


def main(argv: Sequence[str] | None = None) -> int:
    """Renames, and says what came of it."""
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.runner.rename", description=__doc__.partition("\n")[0]
    )
    parser.add_argument("names", nargs="*", metavar="OLD=NEW", help="settings, with dots into nested ones")
    parser.add_argument(
        "--value", action="append", default=[], metavar="NEW:WAS=NOW", type=_value_of, help="JSON: tau_mutual:2.0=null"
    )
    parser.add_argument("--records", type=Path, default=PUBLISHED)
    args = parser.parse_args(argv)
    if wrong := [n for n in args.names if n.count("=") != 1]:
        parser.error(f"expected OLD=NEW, got {wrong[0]!r}")
    for old, new in rename(args.records, dict(n.split("=") for n in args.names), args.value):
        print(f"{old} -> {new}")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except ConfigError as error:
        sys.exit(f"error: {error}")
