"""The pages on the paper, on conventions and on extending name what is in the code: files, names and numbers."""

from __future__ import annotations

import ast
import importlib
import math
import re
from functools import cache
from pathlib import Path

import pytest

from surveilnav.benchmark.policies.surveilnav import AS_WRITTEN
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "understand" / "paper.md"
TEXT = PAGE.read_text()
#: (page, text, target) of links into this repository; a text in code font is a name in the target.
LINKS = [
    (page.name, text, (page.parent / target.partition("#")[0]).resolve() if not target.startswith("#") else target)
    for page in (PAGE, PAGE.with_name("conventions.md"), *sorted((ROOT / "docs" / "extend").glob("*.md")))
    for text, target in re.findall(r"\[([^\]]+)\]\(((?!https?://)[^)]*)\)", page.read_text())
]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")]
    for line in TEXT.partition("## Parameters")[2].partition("\n## ")[0].splitlines()
    if line.startswith("| ") and not line.startswith("| parameter")
]


@cache
def names_in(file: Path) -> frozenset[str]:
    """What a file defines at its top level, and ``Class.member`` for what its classes have; parsed, not imported."""
    tree = ast.parse(file.read_text())
    found = {name for node in tree.body for name in _defined(node)}
    members: dict[str, set[str]] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            inherited = [members.get(base.id, set()) for base in node.bases if isinstance(base, ast.Name)]
            own = {name for inner in node.body for name in _defined(inner)}
            members[node.name] = own.union(_set_on_self(node), *inherited)
    return frozenset(found | {f"{name}.{member}" for name, inside in members.items() for member in inside})


def _defined(node: ast.stmt) -> list[str]:
    if isinstance(node, ast.ClassDef | ast.FunctionDef):
        return [node.name]
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return [t.id for t in targets if isinstance(t, ast.Name)]


def _set_on_self(node: ast.ClassDef) -> list[str]:
    return [
        n.attr
        for n in ast.walk(node)
        if isinstance(n, ast.Attribute)
        and isinstance(n.ctx, ast.Store)
        and isinstance(n.value, ast.Name)
        and n.value.id == "self"
    ]


def is_in(name: str, file: Path) -> bool:
    """Whether a file defines a name. Of ``CONSTANT.attribute`` the constant counts: what it holds, only Python knows."""
    first = name.partition(".")[0]
    return name in names_in(file) or (first.isupper() and first in names_in(file))


def value_of(name: str, target: str) -> object:
    """What a name holds; of a setting, its default."""
    module = target.removeprefix("../../").removeprefix("shared/").removesuffix(".py").replace("/", ".")
    first, *parts = name.split(".")
    value = getattr(importlib.import_module(module), first)
    value = value() if isinstance(value, type) else value
    for part in parts:
        value = getattr(value, part)
    return value


def parts_of(config: object) -> dict[str, object]:
    """The parts of a settings object by the names of their classes, itself included."""
    found = {type(config).__name__: config}
    for name in type(config).model_fields:
        inner = getattr(config, name)
        if hasattr(type(inner), "model_fields"):
            found |= parts_of(inner)
    return found


OURS = parts_of(FusionConfig()) | parts_of(PlannerConfig())
LETTER = parts_of(FusionConfig.preset("paper")) | parts_of(AS_WRITTEN)


def read(cell: str) -> object:
    """The value that a cell says: `0.4`, `"region"`, `radians(30)`."""
    text = cell.strip("`")
    if degrees := re.fullmatch(r"radians\((-?\d+)\)", text):
        return math.radians(int(degrees[1]))
    return ast.literal_eval(text)


def same(a: object, b: object) -> bool:
    return math.isclose(a, b, rel_tol=1e-9) if isinstance(a, float) and isinstance(b, float) else a == b


def named(text: str) -> bool:
    return text.startswith("`")


def test_the_pages_are_read():
    assert sum(named(text) for page, text, _ in LINKS if page == PAGE.name) > 140
    assert len({page for page, _, _ in LINKS}) == 7
    assert len(ROWS) > 35


@pytest.mark.parametrize(("page", "target"), sorted({(page, str(target)) for page, _, target in LINKS}))
def test_every_link_leads_somewhere(page, target):
    if target.startswith("#"):
        headings = [
            re.sub(r"[^\w\- ]", "", h).strip().lower().replace(" ", "-") for h in re.findall("(?m)^#+ (.*)", TEXT)
        ]
        assert target[1:] in headings
    else:
        assert Path(target).is_file(), f"{page}: there is no {target}"


@pytest.mark.parametrize(
    ("page", "name", "file"), sorted({(page, text[1:-1], target) for page, text, target in LINKS if named(text)})
)
def test_every_name_is_in_its_file(page, name, file):
    assert is_in(name, file), f"{page}: {file.relative_to(ROOT)} has no {name}; was it renamed?"


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_every_number_is_the_code_s(row):
    _, _, ours, letter, where = row
    name, target = re.findall(r"\[`([^`]+)`\]\(([^)]*)\)", where)[0]
    owner, _, field = name.partition(".")
    if ours and owner in OURS:
        assert same(getattr(OURS[owner], field), read(ours)), name
        assert same(getattr(LETTER[owner], field), read(letter)), f"{name}, the paper to the letter"
    elif ours:
        assert same(value_of(name, target), read(ours)), name
        assert letter == "", f"{name} is no setting of the maps or the planner: both programs have it"


def test_a_name_that_isnt_there_is_noticed(tmp_path):
    file = tmp_path / "module.py"
    file.write_text(
        "LIMIT: int = 3\n\nclass Map:\n    cell_m: float = 1\n\n    def add(self):\n        self.size = 1\n"
    )
    assert all(is_in(name, file) for name in ("LIMIT", "LIMIT.real", "Map", "Map.cell_m", "Map.add", "Map.size"))
    assert not any(is_in(name, file) for name in ("Limit", "Map.remove", "add", "Plan", "Map.add.size"))


@pytest.mark.parametrize("name", ["Oracle", "Verdict", "judge", "Backend", "canonical", "ShortestPathPlanner"])
def test_a_word_that_means_one_thing_is_defined_once(name):
    files = [
        file
        for package in ("shared", "services", "simulator", "benchmark", "cli")
        for file in (ROOT / package).rglob("*.py")
        if name in names_in(file)
    ]
    assert len(files) == 1, f"{name} is defined in {[str(file.relative_to(ROOT)) for file in files]}"
