"""``surveilnav homes``: surveys every building in a folder, a row of the table each."""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from surveilnav.cli.terminal import plain
from surveilnav.errors import ConfigError, SurveilNavError
from surveilnav.simulator.meshes import is_mesh
from surveilnav.simulator.meshes.layout import is_hm3d
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.reach import Survey, survey


@dataclass(frozen=True)
class SurveyedFile:
    """A file with its survey, or the error why it can't be read."""

    file: str
    survey: Survey | None
    error: str = ""
    seconds: float = 0.0
    sha256: str = ""


def survey_folder(
    folder: Path, on_file: Callable[[int, int, str], None] = lambda done, of, which: None
) -> list[SurveyedFile]:
    """Opens every building in a folder; whatever a file holds, the next one has its turn.

    Args:
        on_file: is told (done, of, which).

    Raises:
        ConfigError: there is no such folder, or no building in it.
    """
    found = homes_in(folder)
    lines = []
    for done, path in enumerate(found):
        name = str(path.relative_to(folder)) if path != folder else path.name
        on_file(done, len(found), name)
        lines.append(_line(path, name))
    on_file(len(found), len(found), "")
    return lines


def homes_in(folder: Path) -> list[Path]:
    """Plans, meshes and folders of HM3D below a folder, by name; the folder itself, if it is one.

    Raises:
        ConfigError: there is none.
    """
    if not folder.exists():
        raise ConfigError(
            f"there is no {folder}: name a folder with .sh3d files, a Home.xml, meshes or folders of HM3D"
        )
    if folder.is_file() or is_hm3d(folder):
        return [folder]
    found: list[Path] = []
    for at, folders, files in os.walk(folder):
        here = Path(at)
        scans = [name for name in folders if is_hm3d(here / name)]
        folders[:] = [name for name in folders if name not in scans]
        found += [here / name for name in scans]
        found += [here / name for name in files if _is_home(here / name)]
    if not found:
        raise ConfigError(
            f"{folder} has no .sh3d file, no Home.xml, no .glb, .gltf or .obj and no folder of HM3D in it"
        )
    return sorted(found)


def _is_home(path: Path) -> bool:
    return path.suffix.lower() == ".sh3d" or path.name.lower() == "home.xml" or is_mesh(path)


def _line(path: Path, name: str) -> SurveyedFile:
    began_s, sha256 = time.monotonic(), _sha256(path)

    def line(found: Survey | None, error: str = "") -> SurveyedFile:
        return SurveyedFile(name, found, error, time.monotonic() - began_s, sha256)

    try:
        scene = open_building(str(path))
        caster = RayCaster(scene)
        return line(survey(scene, NavigationMap.build(scene, caster=caster), caster))
    except (SurveilNavError, OSError) as error:
        return line(None, str(error))
    except (Exception, MemoryError) as error:  # a bug of ours, which shouldn't hide the other files
        return line(None, f"can't be opened by a mistake of this program: {type(error).__name__}: {error}")


def _sha256(path: Path) -> str:
    """Of a file's bytes; empty for a folder, or what can't be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return ""


def as_dict(line: SurveyedFile) -> dict[str, Any]:
    """As ``--json`` says it: areas in m², ``targets`` as [those that robots can get to, all] by class."""
    if line.survey is None:
        return {"file": line.file, "sha256": line.sha256, "error": line.error, "seconds": round(line.seconds, 1)}
    found = line.survey
    return {
        "file": line.file,
        "sha256": line.sha256,
        "levels": [_rounded(asdict(floor)) for floor in found.reach.floors],
        "rooms": found.rooms,
        **_rounded(
            {
                "free_m2": found.reach.free_m2,
                "reached_m2": found.reach.reached_m2,
                "reached_open_m2": found.reached_open_m2,
            }
        ),
        "targets": {label: list(counts) for label, counts in found.targets.items()},
        "says": found.reach.sentence,
        "notes": list(found.notes),
        "seconds": round(line.seconds, 1),
    }


def _rounded(values: dict[str, Any]) -> dict[str, Any]:
    """Areas to the dm²."""
    return {name: round(value, 2) if isinstance(value, float) else value for name, value in values.items()}


def show(lines: list[SurveyedFile], console: Console) -> None:
    """A table of what can be searched, then what there is to say of each file."""
    table = Table(box=None, pad_edge=False)
    table.add_column("file", overflow="fold", ratio=1)
    for column in ("levels", "rooms", "reached", "of m²", "%", "targets"):
        table.add_column(column, justify="right", no_wrap=True)
    for line in lines:
        table.add_row(escape(plain(line.file)), *_cells(line))
    console.print(table)
    for line in lines:
        for text in [line.error] if line.survey is None else [line.survey.reach.sentence, *line.survey.notes]:
            if text:
                console.print(f"{line.file}: {text}", markup=False, style="red" if line.survey is None else None)
    read = sum(line.survey is not None for line in lines)
    console.print(f"{read} of {len(lines)} files could be read")


def _cells(line: SurveyedFile) -> list[str]:
    if line.survey is None:
        return ["", "", "", "", "", "[red]error[/]"]
    reach, targets = line.survey.reach, line.survey.targets.values()
    share = f"{100 * reach.reached_m2 / reach.free_m2:.0f}" if reach.free_m2 else "-"
    near, of = sum(n for n, _ in targets), sum(n for _, n in targets)
    areas = [f"{reach.reached_m2:.0f}", f"{reach.free_m2:.0f}", share]
    return [str(len(reach.floors)), str(line.survey.rooms), *areas, f"{near} of {of}"]
