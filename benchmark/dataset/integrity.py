"""Whether a dataset's files are those that its manifest was written for: all of them, and no others."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from surveilnav.benchmark.dataset import format as files
from surveilnav.benchmark.dataset.format import Manifest
from surveilnav.benchmark.dataset.load import load_scene
from surveilnav.benchmark.dataset.splits import SceneSpec
from surveilnav.errors import ConfigError

#: Where a scene's files lie within a split.
_FILES = ("scenes/{}.json", "content/{}.json.gz", "cameras/{}.json.gz")


def read_manifest(root: Path) -> Manifest:
    """As ``format.manifest_of``, and bytes that aren't text are a ConfigError, too."""
    try:
        return files.manifest_of(root)
    except UnicodeDecodeError as error:
        raise ConfigError(f"{root / 'dataset.json'} is damaged ({error}); build the dataset anew") from error


def files_of(split: str, scenes: Iterable[str]) -> set[str]:
    """All files of a split with these scenes, by their path within the dataset."""
    return {f"{split}/{split}.json.gz", *(f"{split}/{file.format(scene)}" for scene in scenes for file in _FILES)}


def files_in(root: Path, split: str) -> set[str]:
    """The files that lie in a split's folder, by their path within the dataset."""
    return {p.relative_to(root).as_posix() for p in (root / split).rglob("*.json*")}


def damage(root: Path, manifest: Manifest, split: str = "", scene: str = "") -> Iterator[tuple[str, str]]:
    """Files that are missing, can't be read, were changed or that the manifest doesn't know, by their path within the dataset,
    and what is wrong with each.

    Args:
        split, scene: look at the files of these alone.
    """
    for one in (
        [split] if split else sorted(manifest.splits.keys() | {name.partition("/")[0] for name in manifest.sha256})
    ):
        known, there = {name for name in manifest.sha256 if name.startswith(f"{one}/")}, files_in(root, one)
        scenes = {_scene_of(name) for name in known | there if name.count("/") == 2}
        for name in sorted(known | there | files_of(one, scenes)):
            if (not scene or scene == _scene_of(name)) and (what := _wrong(root / name, manifest.sha256.get(name))):
                yield name, what


def _wrong(path: Path, expected: str | None) -> str:
    """What is wrong with a file, empty if nothing is; ``expected``: the manifest's hash of it."""
    if expected is None:
        return "isn't in the manifest" if path.exists() else "is missing, in the manifest, too"
    try:
        found = files.sha256_of(path)
    except ConfigError as error:
        return str(error)
    return "" if found == expected else f"was changed: SHA-256 {found[:12]}, the manifest says {expected[:12]}"


def damaged_scenes(root: Path, manifest: Manifest, split: str) -> set[tuple[str, str]]:
    """Split and name of the scenes of a split that have a file with which something is wrong."""
    return {(split, _scene_of(name)) for name, _ in damage(root, manifest, split) if name.count("/") == 2}


def _scene_of(name: str) -> str:
    return name.rpartition("/")[2].removesuffix(".gz").removesuffix(".json")


def is_whole(root: Path, split: str, spec: SceneSpec, n_episodes: int) -> bool:
    """Whether a scene's three files are there, of this version's format, and made of that building with so many episodes."""
    try:
        data = load_scene(root, split, spec.scene)
    except (ConfigError, UnicodeDecodeError):
        return False
    r = data.record
    same = (r.building, r.seed, r.models) == (spec.building, spec.seed, spec.models)
    return same and len(data.content.episodes) == n_episodes
