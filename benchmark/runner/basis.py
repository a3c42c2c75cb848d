"""What a run's numbers stand on besides its settings: the dataset and the program."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path
from typing import NamedTuple

import benchmark
import services
import surveilnav
from benchmark.dataset import format as files

#: What decides how a search goes, by package; the rest opens, counts and prints.
_PARTS = {
    benchmark: (
        "episode.py",
        "sight.py",
        "perception.py",
        "oracle.py",
        "policies",
        "runner/play.py",
        "runner/settings.py",
    ),
    services: ("fusion/core", "planner/core", "robot_node/core.py", "camera_node/core.py"),
    surveilnav: ("building", "geometry", "perception", "sensing", "categories.py"),
}


class Basis(NamedTuple):
    """Hashes; a run's folder takes episodes of one basis only."""

    dataset: str
    program: str


def basis_of(root: Path, split: str) -> Basis:
    """What an episode of a split is played on.

    Raises:
        ConfigError: there is no such dataset.
    """
    manifest = files.manifest_of(root)
    mine = sorted((k, v) for k, v in manifest.sha256.items() if k.startswith(f"{split}/"))
    return Basis(hashlib.sha256(repr(mine).encode()).hexdigest(), program_hash())


@cache
def program_hash() -> str:
    """Of the code that plays searches, without comments and docstrings: rewording them changes no number."""
    whole = hashlib.sha256()
    for package, parts in _PARTS.items():
        folder = Path(str(next(iter(package.__path__))))
        for part in parts:
            modules = sorted((folder / part).rglob("*.py")) if (folder / part).is_dir() else [folder / part]
            for module in modules:
                whole.update(str(module.relative_to(folder)).encode() + b"\0" + meaning(module.read_text()).encode())
    return whole.hexdigest()


def meaning(source: str) -> str:
    """Source text as its syntax tree, without comments, layout and docstrings."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef) and body:
            first = body[0]
            if (
                isinstance(first, ast.Expr)
                and isinstance(first.value, ast.Constant)
                and isinstance(first.value.value, str)
            ):
                node.body = body[1:]
    return ast.dump(tree)
