"""Whether a dataset's files are those that its manifest was written for."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmark.dataset import format as files
from benchmark.dataset.format import Manifest
from benchmark.dataset.load import load_scene
from surveilnav.errors import ConfigError


def damage(root: Path, manifest: Manifest, split: str = "") -> Iterator[tuple[str, str]]:
    """Files that are missing, can't be read or were changed, by their path within the dataset, and what is wrong with each.

    Args:
        split: look at this one's files alone.
    """
    for name, expected in manifest.sha256.items():
        if split and not name.startswith(f"{split}/"):
            continue
        try:
            found = files.sha256_of(root / name)
        except ConfigError as error:
            yield name, str(error)
            continue
        if found != expected:
            yield name, f"was changed: SHA-256 {found[:12]}, the manifest says {expected[:12]}"


def damaged_scenes(root: Path, manifest: Manifest, split: str) -> set[tuple[str, str]]:
    """Split and name of the scenes of a split that have a file which is missing, can't be read or was changed."""
    names = (Path(name) for name, _ in damage(root, manifest, split))
    return {(split, name.name.removesuffix(".gz").removesuffix(".json")) for name in names if len(name.parts) == 3}


def is_whole(root: Path, split: str, scene: str) -> bool:
    """Whether a scene's three files are there and of this version's format."""
    try:
        load_scene(root, split, scene)
    except ConfigError:
        return False
    return True
