"""How much of homes that other people drew robots can search: two runs of ``surveilnav homes``, and searches in them.

    surveilnav homes FOLDER --json > AFTER.json
    python -m surveilnav.benchmark.studies.others BEFORE.json AFTER.json --index INDEX.tsv --drawn BEFORE.json AFTER.json \
        --on RUN --off RUN
    python -m surveilnav.benchmark.studies.taken RUN --root DATASET > TAKEN.json    # of both runs, for --taken ON.json OFF.json

The homes themselves stay out of the repository: the index (tab-separated, with the columns file, owner/repo, path,
left_out) names them. ``left_out`` says why a home doesn't count; of two files with the same bytes one doesn't. ``--drawn``:
the same for the plans of ``python -m tests.simulator.plans.drawn``. The runs are folders of ``surveilnav bench run`` over
a split of some of these homes, with and without cameras.
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

from surveilnav.benchmark.runner.records import read
from surveilnav.benchmark.runner.row import EpisodeRecord
from surveilnav.benchmark.studies.taken import Taken, read_taken
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


class Index:
    """How the page calls files, and which it leaves out. Without a table nobody has another name."""

    def __init__(self, path: Path | None) -> None:
        rows = []
        if path is not None:
            with path.open(encoding="utf-8", newline="") as file:
                rows = list(csv.DictReader(file, delimiter="\t"))
        try:
            self._names = {row["file"]: f"{row['owner/repo']}: {row['path']}" for row in rows}
            self._left_out = {row["file"]: row["left_out"] for row in rows if row["left_out"]}
        except KeyError as error:
            raise ConfigError(
                f"{path} has no column {error}: expected file, owner/repo, path and left_out, by tabs"
            ) from error

    def name(self, file: str) -> str:
        """ "owner/repo: path"."""
        return _cell(self._names.get(file, file))

    def sorted(self, homes: Mapping[str, Home]) -> tuple[list[str], dict[str, str]]:
        """(files that count, in the order of their names; why each of the others doesn't)."""
        out, seen = dict[str, str](), dict[str, str]()
        for file in sorted(homes, key=lambda file: self.name(file).lower()):
            sha256 = homes[file].get("sha256", "")
            if file in self._left_out:
                out[file] = self._left_out[file]
            elif sha256 and sha256 in seen:
                out[file] = f"the same bytes as {self.name(seen[sha256])}"
            else:
                seen[sha256 or file] = file
        return list(seen.values()), out


def page(
    before: Mapping[str, Home],
    after: Mapping[str, Home],
    index: Index,
    runs: Mapping[str, Sequence[EpisodeRecord]],
    drawn: tuple[Mapping[str, Home], Mapping[str, Home]] | None = None,
    taken: Mapping[str, Taken] | None = None,
) -> str:
    """The page, in Markdown. ``runs``: searches with cameras ("on") and without ("off"), if there are any; ``drawn``: plans of
    our own before and after; ``taken``: of each run, what was taken for the target."""
    files, left_out = index.sorted(after)
    parts = [_head(before, after, files), _drawn(*drawn) if drawn else "", _areas(before, after, index, files)]
    parts += [_reasons(after, index, files), _left_out(index, left_out)]
    if any(runs.values()):
        parts += [_searches(runs), _failures(runs, taken or {})]
    return "\n".join(part for part in parts if part)


def _head(before: Mapping[str, Home], after: Mapping[str, Home], files: Sequence[str]) -> str:
    then, now = ([s for f in files if (s := _share(homes.get(f))) is not None] for homes in (before, after))
    ways = [after[f] for f in files if (_open_share(after[f]) or 0.0) >= _ENOUGH]
    kept = sum((_share(home) or 0.0) >= _ENOUGH for home in ways)
    return "\n".join(
        [
            "# Homes of others",
            "",
            f"**In {sum(s >= _ENOUGH for s in now)} of {len(files)} homes robots reach at least {_ENOUGH:.0%} of the free floor; "
            f"before in {sum(s >= _ENOUGH for s in then)}.** {len(now)} could be read and have floor, before {len(then)}. "
            f"In {len(ways)} homes the plan's own doors and stairs lead to so much, if all doors stood open: "
            f"robots reach it in {kept}.",
            "",
            "Other people published these homes in public repositories. None of them is in this one. "
            "`surveilnav homes FOLDER --json` surveyed them, *before* by the program of dataset v1. "
            "`python -m surveilnav.benchmark.studies.others` wrote the page.",
            "",
        ]
    )


def _drawn(before: Mapping[str, Home], after: Mapping[str, Home]) -> str:
    lines = [
        "## Plans drawn for each fault",
        "",
        "Small plans of our own (`python -m tests.simulator.plans.drawn FOLDER`), each with one fault that people's plans "
        "have.",
        "",
        "| fault | reached before, m² | after, m² | targets before | after |",
        "|---|---|---|---|---|",
    ]
    for file in sorted(after):
        then, now = (_reached(homes.get(file)) for homes in (before, after))
        lines.append(
            f"| {_cell(Path(file).stem)} | {then} | {now} | {_targets(before.get(file))} | {_targets(after[file])} |"
        )
    return "\n".join([*lines, ""])


def _reached(home: Home | None) -> str:
    if home is None or "error" in home:
        return "can't be read"
    return f"{home['reached_m2']:.0f}"


def _left_out(index: Index, why: Mapping[str, str]) -> str:
    if not why:
        return ""
    lines = ["## Left out", "", "| file | why |", "|---|---|"]
    lines += [f"| {index.name(file)} | {_cell(reason)} |" for file, reason in why.items()]
    return "\n".join([*lines, ""])


def _areas(before: Mapping[str, Home], after: Mapping[str, Home], index: Index, files: Iterable[str]) -> str:
    lines = [
        "## Floor reached",
        "",
        "Of the m² indoors where a robot could stand, those that robots get to. "
        "*By its doors*: the share that they would get to if every door of the plan stood open. Targets: things with a "
        "class that they get to.",
        "",
        "| home | levels | rooms | before, m² | % | after, m² | % | by its doors, % | targets before | after |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for file in files:
        then, now = before.get(file), after[file]
        levels, rooms = (len(now["levels"]), now["rooms"]) if "levels" in now else ("", "")
        by_doors = _open_share(now)
        cells = [
            levels,
            rooms,
            *_area(then),
            *_area(now),
            "" if by_doors is None else f"{100 * by_doors:.0f}",
            _targets(then),
            _targets(now),
        ]
        lines.append(f"| {index.name(file)} | {' | '.join(map(str, cells))} |")
    return "\n".join([*lines, ""])


def _area(home: Home | None) -> tuple[str, str]:
    if home is None:
        return "", ""
    if "error" in home:
        return "can't be read", ""
    share = _share(home)
    return f"{home['reached_m2']:.0f} of {home['free_m2']:.0f}", "-" if share is None else f"{100 * share:.0f}"


def _share(home: Home | None, reached: str = "reached_m2") -> float | None:
    """Of the free floor, 0-1; None where there is none, or nobody said."""
    if home is None or not home.get("free_m2") or reached not in home:
        return None
    return float(home[reached]) / float(home["free_m2"])


def _open_share(home: Home) -> float | None:
    """The same if every door stood open. A robot may stand where a leaf was, too: that is no more than all."""
    share = _share(home, "reached_open_m2")
    return None if share is None else min(1.0, share)


def _targets(home: Home | None) -> str:
    if home is None or "targets" not in home:
        return ""
    near, of = (sum(counts[i] for counts in home["targets"].values()) for i in (0, 1))
    return f"{near} of {of}"


def _reasons(after: Mapping[str, Home], index: Index, files: Iterable[str]) -> str:
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
        lines.append(f"| {index.name(file)} | {_cell(why)} |")
    return "\n".join([*lines, ""])


def _searches(runs: Mapping[str, Sequence[EpisodeRecord]]) -> str:
    scenes = sorted({r.scene for records in runs.values() for r in records})
    lines = [
        "## Searches",
        "",
        "Successes of searches, and their SPL in percent. Real detectors (`onnx-coco`) look at rendered pixels; there is a "
        "camera for 100 m². `surveilnav dataset build --building FILE --split others` drew the searches, and "
        "`surveilnav bench run --split others` played them.",
        "",
        "| home | with cameras | SPL | without | SPL |",
        "|---|---|---|---|---|",
    ]
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


def _failures(runs: Mapping[str, Sequence[EpisodeRecord]], taken: Mapping[str, Taken]) -> str:
    counts = {arm: Counter(r.reason for r in runs.get(arm, ()) if not r.success) for arm in ("on", "off")}
    lines = ["## Failures", "", "| cause | with cameras | without |", "|---|---|---|"]
    lines += [
        f"| {_cell(w)} | {counts['on'][w]} | {counts['off'][w]} |" for w in sorted({*counts["on"], *counts["off"]})
    ]
    lines += [
        "",
        "*Taken for it*: what most points of the object lie on that the robot stopped at, by the simulator's truth.",
        "",
        "| home | search | target | cameras | cause | taken for it | it was seen | away from it, m |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for arm in ("on", "off"):
        for r in runs.get(arm, ()):
            if not r.success:
                away = "no way" if r.distance_m is None else f"{r.distance_m:.1f}"
                seen, thing = "yes" if r.seen else "no", _cell(taken.get(arm, {}).get(r.key, ""))
                cells = [_cell(r.scene), r.episode_id, r.category, arm, _cell(r.reason), thing, seen, away]
                lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def _cell(text: str) -> str:
    """Other people's words in a cell of a table: no markup."""
    plain = " ".join(text.replace("`", "'").replace("|", "/").replace("<", "&lt;").split())
    return plain.replace("[", "(").replace("]", ")")[:300]


def main(argv: Sequence[str] | None = None) -> int:
    """Writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m surveilnav.benchmark.studies.others", description=__doc__.splitlines()[0]
    )
    parser.add_argument("before", type=Path, help="what `surveilnav homes --json` said before")
    parser.add_argument("after", type=Path, help="what it says now")
    parser.add_argument("--index", type=Path, help="a table of the files' repositories and paths")
    parser.add_argument(
        "--drawn", type=Path, nargs=2, metavar=("BEFORE", "AFTER"), help="the same of plans drawn by us"
    )
    parser.add_argument("--on", type=Path, help="a run's folder: searches with cameras")
    parser.add_argument("--off", type=Path, help="a run's folder: searches without")
    parser.add_argument("--taken", type=Path, nargs=2, metavar=("ON", "OFF"), help="what `studies.taken` said of them")
    parser.add_argument("--out", type=Path, default=Path("docs/results/homes_of_others.md"))
    options = parser.parse_args(argv)
    runs = {arm: read(folder) for arm, folder in (("on", options.on), ("off", options.off)) if folder}
    drawn = (survey_of(options.drawn[0]), survey_of(options.drawn[1])) if options.drawn else None
    taken = dict(zip(("on", "off"), map(read_taken, options.taken or ()), strict=False))
    text = page(survey_of(options.before), survey_of(options.after), Index(options.index), runs, drawn, taken)
    options.out.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except SurveilNavError as error:
        sys.exit(f"error: {error}")
