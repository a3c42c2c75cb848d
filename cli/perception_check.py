"""Which weights of detectors this machine has."""

from __future__ import annotations

from surveilnav.cli.finding import Finding
from surveilnav.config import models_dir, offline
from surveilnav.errors import SurveilNavError
from surveilnav.perception.models import CATALOGUE, COCO_DETECTORS, is_here, model_id, survey
from surveilnav.perception.names import BackendName


def check_weights() -> list[Finding]:
    """Our own network, and those that are pulled."""
    return [_built_in(), _models()]


def _built_in() -> Finding:
    """Our own network, which ``auto`` takes in simulated buildings, and where the detectors of COCO can't be had."""
    seen = survey(BackendName.COMPACT)
    if seen.fault:
        return Finding("compact", "problem", seen.fault, "install SurveilNav again, or unset SURVEILNAV_COMPACT")
    if seen.path is None:
        return Finding("compact", "note", "its weights don't come with this version: auto takes another detector")
    what = f"{model_id(BackendName.COMPACT, seen.path)}, {seen.path.stat().st_size / 1e6:.1f} MB"
    return Finding("compact", "ok", f"{what}: what auto takes in simulated buildings")


def _models() -> Finding:
    try:
        folder = models_dir()
        found = {name: survey(name) for name, model in CATALOGUE.items() if not model.built_in}
    except SurveilNavError as error:
        return Finding("models", "problem", str(error), "unset SURVEILNAV_MODELS_DIR or point it at a folder")
    if wrong := [seen.fault for name, seen in found.items() if seen.fault and name in COCO_DETECTORS]:
        return Finding("models", "problem", " ".join(wrong), "surveilnav models check")
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
