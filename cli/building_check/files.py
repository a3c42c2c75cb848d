"""The files of a building, as far as they can be read, and what is wrong with the others."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from shlex import quote

from surveilnav.building_file import BuildingFile, load_building
from surveilnav.cameras_file import CamerasFile, load_cameras
from surveilnav.cli.finding import Finding
from surveilnav.errors import ConfigError
from surveilnav.robot_file import RobotFile, load_robot


@dataclass(frozen=True)
class Files:
    """What could be read. ``cameras`` is None if that file can't be used at all."""

    path: Path
    building: BuildingFile
    cameras: CamerasFile | None = None
    robots: dict[str, RobotFile] = field(default_factory=dict)

    def shown(self, path: Path) -> Path:
        """A path of the building file as a person would type it: beside that file, as that was named."""
        folder = self.path.resolve().parent
        return self.path.parent / path.relative_to(folder) if path.is_relative_to(folder) else path


def read_files(path: Path) -> tuple[Files, list[Finding]]:
    """Reads the building file and those that it names.

    Raises:
        ConfigError: the building file can't be used.
    """
    files = Files(path, load_building(path))
    findings = [Finding(str(path), "ok", f"building {files.building.building}")]
    cameras = _read_cameras(files, findings)
    robots = {}
    for name, robot in files.building.robots.items():
        where = str(files.shown(robot))
        try:
            robots[name] = load_robot(robot)
            findings.append(Finding(where, "ok", f"robot {name}"))
        except ConfigError as error:
            findings.append(Finding(where, "problem", str(error), f"correct it, or take {name} out of {path}"))
    findings += _unreadable(files, [path.resolve(), files.building.cameras, *files.building.robots.values()])
    return Files(path, files.building, cameras, robots), findings


def _unreadable(files: Files, paths: list[Path]) -> list[Finding]:
    """Notes what a container, which runs as another user, can't read: of the files and of the folders that it sees."""
    folder = files.path.resolve().parent
    seen = dict.fromkeys(p for path in paths for p in (path, *path.parents) if p.is_relative_to(folder) and p.exists())
    told = "containers run as another user, who can't read it"
    findings = []
    for p in seen:
        right, bits = ("o+rx", 0o005) if p.is_dir() else ("o+r", 0o004)
        if bits & ~p.stat().st_mode:
            shown = str(files.shown(p))
            findings.append(Finding(shown, "note", told, f"chmod {right} {quote(shown)}"))
    return findings


def _read_cameras(files: Files, findings: list[Finding]) -> CamerasFile | None:
    where = files.shown(files.building.cameras)
    try:
        cameras = load_cameras(files.building.cameras)
    except ConfigError as error:
        findings.append(Finding(str(where), "problem", str(error), f"surveilnav cameras check {where}"))
        return None
    for problem in cameras.problems:
        findings.append(Finding(str(where), "problem", str(problem), "correct it there"))
    for floor in files.building.floors:
        if floor not in cameras.floors:
            told = f"floor {floor} isn't one of {where}, which has {', '.join(cameras.floors)}"
            findings.append(Finding(str(files.path), "problem", told, "correct its name, or add it to both"))
    if cameras.cameras and not cameras.problems:
        findings.append(Finding(str(where), "ok", f"cameras {', '.join(cameras.cameras)}"))
    elif not cameras.problems:
        findings.append(Finding(str(where), "note", "it has no camera"))
    return cameras
