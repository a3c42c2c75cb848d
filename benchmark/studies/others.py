"""How much of homes that other people drew robots can search: two runs of ``surveilnav homes``, and searches in them.

    surveilnav homes FOLDER --json > AFTER.json
    python -m benchmark.studies.others BEFORE.json AFTER.json --index INDEX.tsv --on RUN --off RUN

The homes themselves stay out of the repository: the index (tab-separated, with the columns file, owner/repo, path) names
them. The runs are folders of ``surveilnav bench run`` over a split of some of these homes, with and without cameras.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from benchmark.runner.records import read
from benchmark.runner.row import EpisodeRecord
from surveilnav.errors import ConfigError, SurveilNavError

#: Where less of the free floor is reached the page says why.
_ENOUGH = 0.85
Home = Mapping[str, Any]


def survey_of(path: Path) -> dict[str, Home]:
    """What ``surveilnav homes --json`` said, by file. ConfigError: it didn't say this."""
    try:
        homes = json.loads(path.read_text("utf-8"))["homes"]
        return {home["file"]: home for home in homes}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} isn't what `surveilnav homes FOLDER --json` prints: {error!r}") from error


def names_of(index: Path | None) -> dict[str, str]:
    """By file, how the page calls a home: "owner/repo: path". Without an index nobody has another name."""
    if index is None:
        return {}
    with index.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file, delimiter="\t"))
    try:
        return {row["file"]: f"{row['owner/repo']}: {row['path']}" for row in rows}
    except KeyError as error:
        raise ConfigError(f"{index} has no column {error}: expected file, owner/repo and path, by tabs") from error


def page(
    before: Mapping[str, Home], after: Mapping[str, Home], names: Mapping[str, str],
    runs: Mapping[str, Sequence[EpisodeRecord]],
) -> str:  # fmt: skip
    """The page, in Markdown. ``runs``: searches with cameras ("on") and without ("off"), if there are any."""
    files = sorted(after, key=lambda file: names.get(file, file).lower())
    parts = [_head(before, after, files), _areas(before, after, names, files), _reasons(after, names, files)]
    if any(runs.values()):
        parts += [_searches(runs), _failures(runs)]
    return "\n".join(parts)


def _head(before: Mapping[str, Home], after: Mapping[str, Home], files: Sequence[str]) -> str:
    then, now = ([s for f in files if (s := _share(homes.get(f))) is not None] for homes in (before, after))
    return "\n".join([
        "# Homes of others", "",
        f"**In {sum(s >= _ENOUGH for s in now)} of {len(files)} homes robots reach at least {_ENOUGH:.0%} of the free floor; "
        f"before in {sum(s >= _ENOUGH for s in then)}.** {len(now)} could be read and have floor, before {len(then)}.", "",
        "Other people published these homes in public repositories. None of them is in this one. "
        "`surveilnav homes FOLDER --json` surveyed them, *before* by the program of dataset v1. "
        "`python -m benchmark.studies.others` wrote the page.", "",
    ])  # fmt: skip


def _areas(
    before: Mapping[str, Home], after: Mapping[str, Home], names: Mapping[str, str], files: Iterable[str]
) -> str:
    lines = [
        "## Floor reached", "", "Of the m² indoors where a robot could stand, those that robots get to. Targets: things with a "
        "class that they get to.", "",
        "| home | levels | rooms | before, m² | % | after, m² | % | targets before | after |",
        "|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for file in files:
        then, now = before.get(file), after[file]
        levels, rooms = (len(now["levels"]), now["rooms"]) if "levels" in now else ("", "")
        cells = [levels, rooms, *_area(then), *_area(now), _targets(then), _targets(now)]
        lines.append(f"| {_name(file, names)} | {' | '.join(map(str, cells))} |")
    return "\n".join([*lines, ""])


def _area(home: Home | None) -> tuple[str, str]:
    if home is None:
        return "", ""
    if "error" in home:
        return "can't be read", ""
    share = _share(home)
    return f"{home['reached_m2']:.0f} of {home['free_m2']:.0f}", "-" if share is None else f"{100 * share:.0f}"


def _share(home: Home | None) -> float | None:
    """Of the free floor, 0-1; None where there is none."""
    if home is None or not home.get("free_m2"):
        return None
    return float(home["reached_m2"]) / float(home["free_m2"])


def _targets(home: Home | None) -> str:
    if home is None or "targets" not in home:
        return ""
    near, of = (sum(counts[i] for counts in home["targets"].values()) for i in (0, 1))
    return f"{near} of {of}"


def _reasons(after: Mapping[str, Home], names: Mapping[str, str], files: Iterable[str]) -> str:
    lines = ["## What can't be reached, and why", "", "| home | reason |", "|---|---|"]
    for file in files:
        home = after[file]
        share = _share(home)
        if "error" in home:
            why = home["error"]
        elif share is None or share < _ENOUGH:
            why = home["says"].partition("m²: ")[2] or (
                "places too small to be named" if share else "it has no floor indoors"
            )
        else:
            continue
        lines.append(f"| {_name(file, names)} | {_cell(why)} |")
    return "\n".join([*lines, ""])


def _searches(runs: Mapping[str, Sequence[EpisodeRecord]]) -> str:
    scenes = sorted({r.scene for records in runs.values() for r in records})
    lines = ["## Searches", "",
             "Successes of searches, and their SPL in percent. Real detectors (`onnx-coco`) look at rendered pixels; there is a "
             "camera for 100 m². `surveilnav dataset build --building FILE --split others` drew the searches, and "
             "`surveilnav bench run --split others` played them.", "",
             "| home | with cameras | SPL | without | SPL |", "|---|---|---|---|---|"]  # fmt: skip
    for scene in scenes:
        lines.append(f"| {_cell(scene)} | {_counted(runs, lambda r, scene=scene: r.scene == scene)} |")
    lines.append(f"| all | {_counted(runs, lambda r: True)} |")
    return "\n".join([*lines, ""])


def _counted(runs: Mapping[str, Sequence[EpisodeRecord]], which: Any) -> str:
    cells = []
    for arm in ("on", "off"):
        played = [r for r in runs.get(arm, ()) if which(r)]
        spl = 100 * sum(r.spl for r in played) / len(played) if played else None
        cells += [f"{sum(r.success for r in played)} of {len(played)}", "" if spl is None else f"{spl:.1f}"]
    return " | ".join(cells)


def _failures(runs: Mapping[str, Sequence[EpisodeRecord]]) -> str:
    counts = {arm: Counter(r.reason for r in runs.get(arm, ()) if not r.success) for arm in ("on", "off")}
    lines = ["## Failures", "", "| cause | with cameras | without |", "|---|---|---|"]
    lines += [
        f"| {_cell(w)} | {counts['on'][w]} | {counts['off'][w]} |" for w in sorted({*counts["on"], *counts["off"]})
    ]
    lines += [
        "",
        "| home | search | target | cameras | cause | it was seen | away from it, m |",
        "|---|---|---|---|---|---|---|",
    ]
    for arm in ("on", "off"):
        for r in runs.get(arm, ()):
            if not r.success:
                away = "no way" if r.distance_m is None else f"{r.distance_m:.1f}"
                seen = "yes" if r.seen else "no"
                lines.append(
                    f"| {_cell(r.scene)} | {r.episode_id} | {r.category} | {arm} | {_cell(r.reason)} | {seen} | {away} |"
                )
    return "\n".join([*lines, ""])


def _name(file: str, names: Mapping[str, str]) -> str:
    return _cell(names.get(file, file))


def _cell(text: str) -> str:
    """Other people's words in a cell of a table: no markup."""
    plain = " ".join(text.replace("`", "'").replace("|", "/").replace("<", "&lt;").split())
    return plain.replace("[", "(").replace("]", ")")[:300]


def main(argv: Sequence[str] | None = None) -> int:
    """Writes the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmark.studies.others", description=__doc__.splitlines()[0])
    parser.add_argument("before", type=Path, help="what `surveilnav homes --json` said before")
    parser.add_argument("after", type=Path, help="what it says now")
    parser.add_argument("--index", type=Path, help="a table of the files' repositories and paths")
    parser.add_argument("--on", type=Path, help="a run's folder: searches with cameras")
    parser.add_argument("--off", type=Path, help="a run's folder: searches without")
    parser.add_argument("--out", type=Path, default=Path("docs/results/homes_of_others.md"))
    options = parser.parse_args(argv)
    runs = {arm: read(folder) for arm, folder in (("on", options.on), ("off", options.off)) if folder}
    text = page(survey_of(options.before), survey_of(options.after), names_of(options.index), runs)
    options.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SurveilNavError as error:
        sys.exit(f"error: {error}")
