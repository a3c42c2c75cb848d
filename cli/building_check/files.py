"""The files of a building, as far as they can be read, and what is wrong with the others."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

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
    return Files(path, files.building, cameras, robots), findings


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
