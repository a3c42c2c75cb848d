"""What this machine has, what it lacks, and how to get it."""

from __future__ import annotations

import importlib
import platform
import shutil
import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from rich.console import Console

from surveilnav.config import cache_dir, models_dir, offline
from surveilnav.errors import SurveilNavError
from surveilnav.perception.models import CATALOGUE, COCO_DETECTORS, is_here, model_id, survey
from surveilnav.perception.names import BackendName
from surveilnav.simulator.furniture.assets import is_here as is_here_already
from surveilnav.simulator.simulation import Progress, SimulatedBuilding, SimulationSettings
from surveilnav.simulator.sources import EXAMPLE_HOMES


@dataclass(frozen=True)
class Finding:
    """One thing looked at. ``level``: ok, note (works without it, less well), missing (must be mended)."""

    what: str
    level: Literal["ok", "note", "missing"]
    detail: str
    remedy: str = ""

    def as_dict(self) -> dict[str, Any]:
        """As ``--json`` says it."""
        return asdict(self)


def examine(building: str = "", progress: Progress | None = None) -> list[Finding]:
    """Looks at Python, packages, furniture, models, disk, Docker, and a building if one is named."""
    findings = [_python(), *_packages(), _assets(), _built_in(), _models(), _disk(), _docker()]
    return [*findings, *([_building(building, progress)] if building else [])]


def _python() -> Finding:
    ok = (3, 11) <= sys.version_info[:2] <= (3, 13)
    return Finding(
        "Python", "ok" if ok else "missing", platform.python_version(), "" if ok else "use Python 3.11 to 3.13"
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
                Finding(name, "missing", str(error), remedies.get(name, "pip install 'surveilnav[simulator]'"))
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


def _built_in() -> Finding:
    """Our own network, which ``auto`` takes in simulated buildings, and where the detectors of COCO can't be had."""
    seen = survey(BackendName.COMPACT)
    if seen.fault:
        return Finding("compact", "missing", seen.fault, "install SurveilNav again, or unset SURVEILNAV_COMPACT")
    if seen.path is None:
        return Finding("compact", "note", "its weights don't come with this version: auto takes another detector")
    what = f"{model_id(BackendName.COMPACT, seen.path)}, {seen.path.stat().st_size / 1e6:.1f} MB"
    return Finding("compact", "ok", f"{what}: what auto takes in simulated buildings")


def _models() -> Finding:
    try:
        folder = models_dir()
        found = {name: survey(name) for name, model in CATALOGUE.items() if not model.built_in}
    except SurveilNavError as error:
        return Finding("models", "missing", str(error), "unset SURVEILNAV_MODELS_DIR or point it at a folder")
    if wrong := [seen.fault for name, seen in found.items() if seen.fault and name in COCO_DETECTORS]:
        return Finding("models", "missing", " ".join(wrong), "surveilnav models check")
    names = [name + (" (damaged or half)" if seen.fault else "") for name, seen in found.items() if seen.path]
    detectors = [name for name in names if name in COCO_DETECTORS]
    if not detectors and offline():
        instead = BackendName.COMPACT if is_here(BackendName.COMPACT) else BackendName.SIMULATED
        remedy = f"perception is `{instead}`; or point SURVEILNAV_MODELS_DIR at a folder with a detector"
        return Finding("models", "note", "no detector is here, and SURVEILNAV_OFFLINE or HF_HUB_OFFLINE is set", remedy)
    if not detectors:
        detail = "no detector is here" if folder is None else f"no detector in {folder}"
        return Finding("models", "note", f"{detail}: the small ones are pulled when needed", "surveilnav models list")
    return Finding("models", "ok", ", ".join(names))


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
        return Finding("building", "missing", str(error), "surveilnav buildings")
    if reach.sentence:
        return Finding("building", "note", f"{name}: {reach.sentence}")
    return Finding("building", "ok", f"{name}: robots reach all of {reach.reached_m2:.0f} m²")


def show(findings: list[Finding], console: Console) -> None:
    """A line a finding."""
    marks = {"ok": "[green]ok[/]     ", "note": "[yellow]note[/]   ", "missing": "[red]missing[/]"}
    for finding in findings:
        remedy = f"  -> {finding.remedy}" if finding.remedy else ""
        console.print(f"{marks[finding.level]} {finding.what}: {finding.detail}{remedy}")
