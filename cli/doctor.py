"""What this machine has, what it lacks, and how to get it."""

from __future__ import annotations

import importlib
import platform
import shutil
import sys
from pathlib import Path
from typing import Literal

from surveilnav.cli.finding import Finding
from surveilnav.cli.perception_check import check_weights
from surveilnav.config import cache_dir
from surveilnav.errors import SurveilNavError
from surveilnav.simulator.furniture.assets import is_here as is_here_already
from surveilnav.simulator.simulation import Progress, SimulatedBuilding, SimulationSettings
from surveilnav.simulator.sources import EXAMPLE_HOMES


def examine(building: str = "", progress: Progress | None = None) -> list[Finding]:
    """Looks at Python, packages, furniture, models, disk, Docker, and a building if one is named."""
    findings = [_python(), *_packages(), _assets(), *check_weights(), _disk(), _docker()]
    return [*findings, *([_building(building, progress)] if building else [])]


def _python() -> Finding:
    ok = (3, 11) <= sys.version_info[:2] <= (3, 13)
    return Finding(
        "Python", "ok" if ok else "problem", platform.python_version(), "" if ok else "use Python 3.11 to 3.13"
    )


def _packages() -> list[Finding]:
    # Imported before ONNX Runtime, which then reports nothing to its maker.
    importlib.import_module("surveilnav.perception.detectors")
    findings = []
    remedies = {"open3d": "apt-get install libusb-1.0-0 libgl1 libegl1 libgomp1 libx11-6"}
    for name in ("zenoh", "open3d", "numba", "onnxruntime", "cv2", "fastapi"):
        try:
            version = getattr(importlib.import_module(name), "__version__", "present")
            findings.append(Finding(name, "ok", str(version)))
        except Exception as error:
            findings.append(
                Finding(name, "problem", str(error), remedies.get(name, "pip install 'surveilnav[simulator]'"))
            )
    return findings


def _assets() -> Finding:
    """Whether the furniture is here; fetching it is `prepare`'s."""
    if is_here_already():
        return Finding("example homes", "ok", f"Sweet Home 3D's {len(EXAMPLE_HOMES)} homes and furniture")
    return Finding(
        "example homes",
        "note",
        "Sweet Home 3D's homes and furniture aren't here yet",
        "surveilnav prepare (needs apt and a network); parametric_flat works without",
    )


def _disk() -> Finding:
    folder: Path = cache_dir()
    free_gb = shutil.disk_usage(folder).free / 1e9
    level: Literal["ok", "note"] = "ok" if free_gb > 4 else "note"
    return Finding(
        "disk", level, f"{free_gb:.1f} GB free at {folder}", "" if level == "ok" else "set SURVEILNAV_CACHE_DIR"
    )


def _docker() -> Finding:
    if shutil.which("docker"):
        return Finding("docker", "ok", "for `docker compose up` (whether an engine runs isn't asked)")
    return Finding("docker", "note", "not installed: only `docker compose up` needs it", "apt-get install docker.io")


def _building(name: str, progress: Progress | None) -> Finding:
    """How much of a building robots can reach."""
    try:
        building = SimulatedBuilding(SimulationSettings(building=name), progress)
        reach = building.reach
    except SurveilNavError as error:
        return Finding("building", "problem", str(error), "surveilnav buildings")
    if reach.sentence:
        return Finding("building", "note", f"{name}: {reach.sentence}")
    return Finding("building", "ok", f"{name}: robots reach all of {reach.reached_m2:.0f} m²")
