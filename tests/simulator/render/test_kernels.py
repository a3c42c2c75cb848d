"""Numba's cache doesn't notice edits in other files: a compiled loop may only call those of its own file."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[3]
#: By dotted name, every file of the project with compiled loops.
FILES = {
    ".".join(("surveilnav", *path.relative_to(ROOT).with_suffix("").parts)): path.read_text()
    for folder in ("simulator", "services", "benchmark")
    for path in (ROOT / folder).rglob("*.py")
    if "njit" in path.read_text()
}


def kernels(source: str) -> dict[str, ast.FunctionDef]:
    """The compiled functions of a file by name."""
    functions = (n for n in ast.parse(source).body if isinstance(n, ast.FunctionDef))
    return {f.name: f for f in functions if any("jit" in ast.unparse(d) for d in f.decorator_list)}


def foreign_calls(source: str, files: dict[str, str]) -> set[str]:
    """Compiled functions of other files that those of ``source`` call, by name or through a module."""
    named, modules = {}, {}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                named[alias.asname or alias.name] = (node.module, alias.name)
                modules[alias.asname or alias.name] = f"{node.module}.{alias.name}"
    found = set()
    for kernel in kernels(source).values():
        for call in (n.func for n in ast.walk(kernel) if isinstance(n, ast.Call)):
            if isinstance(call, ast.Name) and call.id in named:
                module, name = named[call.id]
            elif isinstance(call, ast.Attribute) and isinstance(call.value, ast.Name) and call.value.id in modules:
                module, name = modules[call.value.id], call.attr
            else:
                continue
            if module in files and name in kernels(files[module]):
                found.add(f"{kernel.name} calls {module}.{name}")
    return found


@pytest.mark.parametrize("name", FILES)
def test_kernels_call_only_kernels_of_their_own_file(name):
    assert foreign_calls(FILES[name], FILES) == set()


@pytest.mark.parametrize(
    "way",
    ["from surveilnav.simulator.render.shading import sky as look", "from surveilnav.simulator.render import shading"],
)
def test_a_planted_call_is_found(way):
    call = "look(0.0, 0.0, 1.0)" if "sky" in way else "shading.sky(0.0, 0.0, 1.0)"
    planted = f"{way}\n@njit(cache=True)\ndef kernel():\n    return {call}\n"
    assert foreign_calls(planted, FILES) == {"kernel calls surveilnav.simulator.render.shading.sky"}


def test_there_are_files_to_look_at():
    assert {"surveilnav.simulator.render.shading", "surveilnav.simulator.render.hashed"} <= set(FILES)
