"""Precision and recall of ``label_of`` on the names that Sweet Home 3D's catalogues give their furniture, by language.

    python -m surveilnav.benchmark.studies.labels

What a piece is, says ``labels_truth.json`` by its catalogue id. Two libraries are held out: their names were not looked at
while ``shared/surveilnav/data/words.json`` was made. ``--missed de`` lists the wrong ones of the other libraries.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from surveilnav.errors import SurveilNavError
from surveilnav.nouns import detect_language
from surveilnav.simulator.archive import Archive
from surveilnav.simulator.furniture.assets import ensure_assets
from surveilnav.simulator.furniture.catalog import (
    DEFAULT_CATALOG,
    JAR,
    LIBRARIES,
    CatalogModel,
    read_catalog,
    read_properties,
)
from surveilnav.simulator.furniture.labels import TARGETS, label_of

_HERE = Path(__file__).parent
OUT = Path("docs/results/labels.md")
#: The page's language codes without a country: "zh_CN", "zh_TW" and the like stay apart.
_LANGUAGE = re.compile(r"FurnitureCatalog_(\w+)\.properties$")


@dataclass(frozen=True, slots=True)
class Named:
    """A catalogue entry as one language calls it."""

    entry: CatalogModel
    language: str
    name: str


@dataclass(frozen=True, slots=True)
class Score:
    """How many labels were right, were said and should have been said."""

    right: int
    said: int
    there: int

    def __add__(self, other: Score) -> Score:
        return Score(self.right + other.right, self.said + other.said, self.there + other.there)

    def __str__(self) -> str:
        return f"{_percent(self.right, self.said)} / {_percent(self.right, self.there)}"


@cache
def truth() -> dict:
    """``labels_truth.json``."""
    table: dict = json.loads((_HERE / "labels_truth.json").read_text("utf-8"))
    return table


def catalogue_names(root: Path) -> list[Named]:
    """All names of all libraries below ``root`` in all their languages, but for what ``labels_truth.json`` is unsure of."""
    paths = [(root / JAR, DEFAULT_CATALOG)]
    paths += [(p, "PluginFurnitureCatalog.properties") for p in sorted((root / LIBRARIES).glob("*.sh3f"))]
    return [named for path, catalogue in paths for named in names_of(path, catalogue)]


def names_of(path: Path, catalogue: str) -> Iterator[Named]:
    """The names in a library's catalogues: ``catalogue`` is the English one, the others lie beside it."""
    archive = Archive(path)
    try:
        english = archive.read(catalogue) or b""
        entries = {entry.id: entry for entry in read_catalog(english, path.stem)}
        ids = {number: row.get("id", "") for number, row in read_properties(english).items()}
        folder = catalogue.rpartition("/")[0]
        for member in sorted(archive.names()):
            found = _LANGUAGE.search(member)
            if member != catalogue and (found is None or member.rpartition("/")[0] != folder or found[1] == "en_US"):
                continue
            for number, row in read_properties(archive.read(member) or b"").items():
                entry = entries.get(ids.get(number, ""))
                if entry is not None and "name" in row and entry.id not in truth()["unsure"]:
                    yield Named(entry, found[1] if found else "en", row["name"])
    finally:
        archive.close()


def labels_by_id() -> dict[str, str]:
    """The true label by catalogue id, of the classes that are scored."""
    return {id_: label for label, ids in truth()["labels"].items() for id_ in ids}


def score(named: Iterable[Named], language: str, classes: Iterable[str]) -> Score:
    """Of ``label_of`` on some names, for some classes; ``language`` as for ``label_of``."""
    right = said = there = 0
    wanted, true = set(classes), labels_by_id()
    for n in named:
        label, expected = label_of(n.name, n.entry.size_m, language), true.get(n.entry.id, "")
        said += label in wanted
        there += expected in wanted
        right += label in wanted and label == expected
    return Score(right, said, there)


def is_held_out(named: Named) -> bool:
    """Whether its names were left unread."""
    return named.entry.library in truth()["held_out"]


def wrong(named: Iterable[Named], language: str) -> list[str]:
    """A line for each name that gets another label than its own."""
    true, scored = labels_by_id(), set(truth()["labels"])
    lines = []
    for n in named:
        label, expected = label_of(n.name, n.entry.size_m, language), true.get(n.entry.id, "")
        if label != expected and {label, expected} & scored:
            lines.append(f"{n.name} ({n.entry.name}): {label or '-'}, should be {expected or '-'}")
    return lines


# --- the page -----------------------------------------------------------------------------------------------------


def page(named: Sequence[Named]) -> str:
    """docs/results/labels.md."""
    libraries = sorted({n.entry.library for n in named})
    held = [library for library in libraries if library in truth()["held_out"]]
    ours, theirs = [n for n in named if not is_held_out(n)], [n for n in named if is_held_out(n)]
    truth_file = "[labels_truth.json](../../benchmark/studies/labels_truth.json)"
    lines = [
        "# What names say about furniture",
        "",
        "Made by `python -m surveilnav.benchmark.studies.labels`. It gives `label_of` every name in Sweet Home 3D's catalogues,",
        "in all",
        "their languages, with the piece's size. What a piece is follows from its catalogue id, checked by hand for",
        f"{len(truth()['labels'])} classes: {truth_file}. Each cell has precision / recall in percent.",
        "",
        "- *before*: the English regular expressions that the table of words replaced.",
        "- *alone*: the name is all that is known.",
        "- *in a home*: the home's other names tell the language. It decides where one word means two things:",
        '  "стол" in Bulgarian and Russian, "Bank" in Dutch and German.',
        "",
        "The sums leave English out.",
    ]
    for title, some, about in (
        ("Libraries that were read", ours, ", ".join(name for name in libraries if name not in held)),
        (
            "Libraries that were held out",
            theirs,
            ", ".join(held) + ": their names were not looked at before the table was done.",
        ),
    ):
        lines += ["", f"## {title}", "", about, ""]
        lines += _table(some, named, held="held out" in title)
        lines += ["", "Most often wrong:", "", *_hardest(some)]
    return "\n".join([*lines, ""])


def _table(some: Sequence[Named], everything: Sequence[Named], *, held: bool) -> list[str]:
    before = json.loads((_HERE / "labels_before.json").read_text("utf-8"))["held out" if held else "read"]
    classes, languages = tuple(truth()["labels"]), sorted({n.language for n in some})
    lines = ["| language | things | before | alone | in a home |", "|---|---|---|---|---|"]
    sums = {kind: [Score(0, 0, 0)] * 3 for kind in ("six", "all")}
    rows = []
    for code in languages:
        mine = [n for n in some if n.language == code]
        home = detect_language(n.name for n in everything if n.language == code)
        for kind, of in (("six", TARGETS), ("all", classes)):
            cells = [Score(*before[code][kind]), score(mine, "", of), score(mine, home, of)]
            if code != "en":
                sums[kind] = [a + b for a, b in zip(sums[kind], cells, strict=True)]
        rows.append(_row(code, cells))
    lines += [_row("**all classes**", sums["all"]), _row("**the six targets**", sums["six"]), *rows]
    return lines


def _hardest(some: Sequence[Named], at_most: int = 6) -> list[str]:
    """The things whose names most languages get wrong, each name alone."""
    true = labels_by_id()
    translated = [n for n in some if n.language != "en"]
    missed = Counter(
        n.entry for n in translated if _scored(label_of(n.name, n.entry.size_m)) != true.get(n.entry.id, "")
    )
    there = Counter(n.entry for n in translated)
    return [
        f"- {entry.name} (`{entry.id}`), should be {true.get(entry.id) or 'none'}: {count} of {there[entry]} languages"
        for entry, count in missed.most_common(at_most)
    ]


def _scored(label: str) -> str:
    return label if label in truth()["labels"] else ""


def _row(name: str, cells: Sequence[Score]) -> str:
    return f"| {name} | {cells[1].there} | " + " | ".join(str(cell) for cell in cells) + " |"


def _percent(part: int, whole: int) -> str:
    return f"{100 * part / whole:.1f}" if whole else "-"


def main(argv: Sequence[str] | None = None) -> int:
    """Writes the page, or lists what is wrong in one language."""
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.labels", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("--out", type=Path, default=OUT, help=f"the page (default {OUT})")
    parser.add_argument(
        "--missed", metavar="LANGUAGE", help="list wrong names of the libraries that are read, write nothing"
    )
    options = parser.parse_args(argv)
    named = catalogue_names(ensure_assets())
    if options.missed:
        mine = [n for n in named if n.language == options.missed and not is_held_out(n)]
        print("\n".join(wrong(mine, detect_language(n.name for n in mine))))
        return 0
    options.out.write_text(page(named), encoding="utf-8")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SurveilNavError as error:
        sys.exit(f"error: {error}")
