"""What pages say is so: links lead somewhere, commands exist, generated pages are current."""

from __future__ import annotations

import importlib.util
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest
import typer

from surveilnav.benchmark.tables import readme
from surveilnav.cli import command_page, settings_page
from surveilnav.cli.exits import Exit
from surveilnav.cli.main import app
from surveilnav.services.gateway.app import create_app

ROOT = Path(__file__).parents[1]
PAGES = sorted(
    path
    for path in ROOT.rglob("*.md")
    if not any(part.startswith(".") or part in ("runs", "data", "build") for part in path.relative_to(ROOT).parts)
)
HAND_WRITTEN = ("README.md", "ARCHITECTURE.md", "CONTRIBUTING.md", "SECURITY.md", "docs/README.md")
# The folders below docs/results have pages that programs write.
WRITTEN_FOLDERS = ("docs/use", "docs/operate", "docs/extend", "docs/understand", "docs/reference", "docs/results")
FOR_READERS = [
    path
    for path in PAGES
    if path.relative_to(ROOT).as_posix() in HAND_WRITTEN or path.parent.relative_to(ROOT).as_posix() in WRITTEN_FOLDERS
]


def ids(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def without_blocks(text: str) -> str:
    """A page without fenced code."""
    return re.sub(r"^```.*?^```[^\n]*$", "", text, flags=re.MULTILINE | re.DOTALL)


# --- links --------------------------------------------------------------------------------------------------------


def broken_links(page: Path) -> Iterator[str]:
    """Relative links and anchors of a page that lead nowhere."""
    text = re.sub(r"`[^`\n]*`", "`", without_blocks(page.read_text(encoding="utf-8")))
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if re.match(r"[a-z]+:", link):  # http, mailto
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        found = target.exists() and (not anchor or (target.suffix == ".md" and anchor in anchors(target)))
        if not found:
            yield link


def anchors(page: Path) -> Iterator[str]:
    """The anchors that GitHub gives to the headings of a page."""
    seen: dict[str, int] = {}
    for heading in re.findall(r"^#{1,6} +(.+?) *$", without_blocks(page.read_text(encoding="utf-8")), re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)  # a link counts by its text
        slug = re.sub(r"[^\w\- ]", "", words.lower()).replace(" ", "-")
        n = seen[slug] = seen.get(slug, -1) + 1
        yield f"{slug}-{n}" if n else slug


@pytest.mark.parametrize("page", PAGES, ids=ids)
def test_every_link_leads_somewhere(page):
    assert list(broken_links(page)) == []


def test_a_broken_link_is_found(tmp_path):
    (tmp_path / "other.md").write_text("# A heading: `code`, [link](x.md)\n```\n# no heading\n```\n# Twice\n# Twice\n")
    page = tmp_path / "page.md"
    page.write_text(
        "[ok](other.md) [ok](other.md#a-heading-code-link) [ok](https://x.org/y) [ok](#here) [ok](other.md#twice-1)\n"
        "# Here\n`[code](nowhere.md)`\n[1](nowhere.md) [2](other.md#no-heading) ![3](no.png) [4](#there) [5](../gone/)\n"
    )
    assert list(broken_links(page)) == ["nowhere.md", "other.md#no-heading", "no.png", "#there", "../gone/"]


def test_every_page_is_reached_from_the_readme():
    reached, todo = set(), [ROOT / "README.md"]
    while todo:
        page = todo.pop()
        if page in reached:
            continue
        reached.add(page)
        for link in re.findall(r"\]\(([^)\s#]+)", page.read_text(encoding="utf-8")):
            target = (page.parent / link).resolve()
            if target.suffix == ".md" and target.exists():
                todo.append(target)
    docs = {page for page in PAGES if page.is_relative_to(ROOT / "docs")}
    assert sorted(ids(page) for page in docs - reached) == []


# --- commands -----------------------------------------------------------------------------------------------------


def code_of(page: Path) -> Iterator[str]:
    """Lines of fenced code and spans of code, comments left out."""
    text = page.read_text(encoding="utf-8")
    for block in re.findall(r"^```[^\n]*\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for line in block.replace("\\\n", " ").splitlines():
            yield line.partition(" #")[0]
    yield from re.findall(r"`([^`\n]+)`", without_blocks(text))


def faults_of_commands(lines: Iterator[str]) -> Iterator[str]:
    """Make targets, commands with their options, and modules that don't exist."""
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for line in lines:
        for target in re.findall(r"(?:^|\s|&& )make ([a-z-]+)", line):
            if target not in targets:
                yield f"make {target}"
        if command := re.search(r"(?:^|[ /=])surveilnav +((?:--)?[a-z].*)$", line):
            yield from _faults_of_command(command[1].split())
        for module in re.findall(r"python -m ((?:surveilnav|simulator|services|cli|benchmark|training)[\w.]*)", line):
            if importlib.util.find_spec(module) is None:
                yield f"python -m {module}"


def _faults_of_command(words: list[str]) -> Iterator[str]:
    command: Any = typer.main.get_command(app)
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        name = words.pop(0)
        if name not in command.commands:
            yield f"surveilnav {name}"
            return
        command = command.commands[name]
    options = {option for parameter in command.params for option in (*parameter.opts, *parameter.secondary_opts)}
    for word in words:
        if word.startswith("--") and word.partition("=")[0] not in options | {"--help"}:
            yield f"surveilnav {command.name} {word}"


@pytest.mark.parametrize("page", FOR_READERS, ids=ids)
def test_commands_exist(page):
    assert list(faults_of_commands(code_of(page))) == []


def test_commands_that_do_not_exist_are_found():
    lines = [
        "make demo",
        "make dinner",
        ".venv/bin/surveilnav bench run --split val",
        "surveilnav bench ran",
        "surveilnav fly",
        "X=1 surveilnav up --wings",
        "python -m benchmark.homes --out x",
        "python -m surveilnav.benchmark.studies.live",
    ]
    assert list(faults_of_commands(iter(lines))) == [
        "make dinner",
        "surveilnav ran",
        "surveilnav fly",
        "surveilnav up --wings",
        "python -m benchmark.homes",
    ]


# --- generated pages ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["settings.md", "settings-expert.md"])
def test_the_settings_pages_are_generated_from_the_classes(name):
    assert (ROOT / "docs/use" / name).read_text(encoding="utf-8") == settings_page.pages()[name], "run: make docs"


def test_every_setting_stands_on_one_of_the_pages_and_few_on_the_common_one():
    rows = {
        name: re.findall(r"^\| `(SURVEILNAV_\w+__\w+)`", page, re.M) for name, page in settings_page.pages().items()
    }
    common, expert = rows["settings.md"], rows["settings-expert.md"]
    tables = [table for section in settings_page.SECTIONS for _, table in settings_page.settings_of(section)]
    assert sorted(common + expert) == sorted(setting.variable for table in tables for setting in table)
    assert set(common) == settings_page.COMMON
    assert 20 <= len(common) <= 30


def test_the_page_of_commands_is_generated_from_them():
    assert (ROOT / "docs/use/command-line.md").read_text(encoding="utf-8") == command_page.markdown(), "run: make docs"


def test_whatever_prints_json_says_what_and_nothing_else_does():
    found = dict(command_page.commands(typer.main.get_command(app)))
    prints = {name for name, command in found.items() if any("--json" in p.opts for p in command.params)}
    assert prints == set(command_page.SHAPES)
    assert set(found) - prints == {"up", "cameras schema"}, "every other command has --json"


def test_every_exit_code_is_on_the_page():
    page = (ROOT / "docs/use/command-line.md").read_text(encoding="utf-8")
    assert re.findall(r"^\| (\d+) \|", page, re.MULTILINE) == [str(int(code)) for code in Exit]
    raised = {int(n) for f in (ROOT / "cli").glob("*.py") for n in re.findall(r"sys\.exit\((\d+)\)", f.read_text())}
    assert raised <= {int(code) for code in Exit}


def test_every_setting_is_described():
    tables = [table for section in settings_page.SECTIONS for table in settings_page.settings_of(section)]
    settings = [setting for _, table in tables for setting in table]
    assert len(settings) > 150
    assert len({s.variable for s in settings}) == len(settings)
    assert [s.variable for s in settings if not s.description] == []


def test_no_settings_class_is_missing_from_the_page():
    files = [p for folder in ("shared", "services", "simulator", "benchmark") for p in (ROOT / folder).rglob("*.py")]
    prefixes = {prefix for path in files for prefix in re.findall(r'env_prefix="(\w+)"', path.read_text())}
    assert prefixes == {str(section.settings.model_config["env_prefix"]) for section in settings_page.SECTIONS}


# --- REST ---------------------------------------------------------------------------------------------------------


def test_the_rest_page_has_every_address_once_with_a_call():
    page = (ROOT / "docs/use/rest.md").read_text(encoding="utf-8")
    paths = create_app(MagicMock(), None).openapi()["paths"]
    there = sorted((method.upper(), path) for path, methods in paths.items() for method in methods)
    assert sorted(re.findall(r"^\| `([A-Z]+) (/\S+)` \|", page, re.MULTILINE)) == there
    calls = [
        (m or "GET", url) for m, url in re.findall(r"^curl (?:-X ([A-Z]+) )?.*?localhost:8080(/[^\s'?]*)", page, re.M)
    ]
    for method, path in there:
        pattern = re.sub(r"\\\{\w+\\\}", r"[\\w-]+", re.escape(path))
        assert [call for call in calls if call[0] == method and re.fullmatch(pattern, call[1])], f"{method} {path}"
    assert len(calls) == len(there)


# --- the README's numbers -----------------------------------------------------------------------------------------


def test_the_readme_says_what_the_published_runs_say():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| ([^|]+?) \| ([\d.]+ % \[[^]]*\] \| [\d.]+ \[[^]]*\]) \|", text, re.MULTILINE))
    lines = {readme.BARS[line.arm.label][0]: line.summary for line in readme.published()}
    assert {"ours, with cameras", "ours, without cameras", "VLFM's rule"} <= set(rows) <= set(lines)
    for name, row in rows.items():
        s = lines[name]
        said = f"{s.sr.mean:.1f} % [{s.sr.low:.1f}, {s.sr.high:.1f}] | {s.spl.mean:.1f} [{s.spl.low:.1f}, {s.spl.high:.1f}]"
        assert row == said, name
