"""What a run's numbers stand on besides its settings: the dataset and the program."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import NamedTuple

import benchmark
import services
import simulator
import surveilnav
from benchmark.dataset.integrity import damage, read_manifest
from benchmark.dataset.load import scenes_of
from surveilnav.errors import ConfigError

#: What decides how a search goes, by package; the rest opens, counts and prints.
_PARTS = {
    benchmark: (
        "dataset/axes.py", "dataset/build.py", "dataset/format.py", "dataset/load.py", "play/episode.py", "play/oracle.py", "policies",
        "runner/play.py", "runner/settings.py", "play/sight.py",
    ),
    services: ("fusion/core", "planner/core", "robot_node/core.py", "camera_node/core.py"),
    simulator: ("",),
    surveilnav: ("geometry", "messages", "perception", "sensing", "categories.py", "bus/wire.py"),
}  # fmt: skip
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


class Basis(NamedTuple):
    """Hashes; a run's folder takes episodes of one basis only."""

    dataset: str
    program: str


def basis_of(root: Path, split: str) -> Basis:
    """What an episode of a split is played on.

    Raises:
        ConfigError: there is no such dataset, or a file of it isn't what its manifest says.
    """
    manifest = read_manifest(root)
    scenes_of(root, split)  # refuses a split that the dataset hasn't
    for name, what in damage(root, manifest, split):
        raise ConfigError(
            f"{root / name} {what}: `surveilnav dataset check` names all that is wrong, `build` mends it or says what to delete"
        )
    mine = sorted((k, v) for k, v in manifest.sha256.items() if k.startswith(f"{split}/"))
    return Basis(hashlib.sha256(repr(mine).encode()).hexdigest(), program_hash())


@cache
def program_hash() -> str:
    """Of the code and the tables that play searches, without comments and docstrings: rewording them changes no number."""
    return hash_of(program_parts())


def program_parts() -> dict[Path, tuple[str, ...]]:
    """The files and folders that make the program, by the folder that they are named from."""
    return {Path(str(next(iter(package.__path__)))): parts for package, parts in _PARTS.items()}


def hash_of(parts: Mapping[Path, Sequence[str]]) -> str:
    """Of modules and of the data beside them: files, or folders with all below, by the folder that they are named from."""
    whole = hashlib.sha256()
    for folder, names in parts.items():
        for name in names:
            found = sorted((folder / name).rglob("*")) if (folder / name).is_dir() else [folder / name]
            for file in found:
                if file.suffix in (".py", ".json"):
                    text = meaning(file.read_text()) if file.suffix == ".py" else file.read_text()
                    whole.update(str(file.relative_to(folder)).encode() + b"\0" + text.encode() + b"\0")
    return whole.hexdigest()


def meaning(source: str) -> str:
    """Source text as its syntax tree, without comments, layout and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            node.body = node.body[1:]
    return ast.dump(tree).replace(", type_params=[]", "")  # which Python has since 3.12
