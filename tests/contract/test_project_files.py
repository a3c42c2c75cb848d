"""What other programs read of the project agrees with it: citation, changelog, extras, hooks, templates."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
import yaml

from surveilnav import __version__

ROOT = Path(__file__).parents[2]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_citation_and_changelog_are_of_this_version():
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))["version"] == __version__
    versions = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert versions[0] == "Unreleased"
    assert __version__ in versions


def test_the_install_page_knows_every_extra():
    page = (ROOT / "docs/use/install.md").read_text(encoding="utf-8")
    named = {extra for extras in re.findall(r"surveilnav\[([\w,-]+)\]", page) for extra in extras.split(",")}
    assert named == set(PROJECT["optional-dependencies"]) - {"docs", "dev"}


def test_every_dependency_is_pinned():
    """Whatever pyproject.toml names has its exact version in constraints.txt."""
    pinned = {line.partition("==")[0] for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line}
    named = [line for lines in PROJECT["optional-dependencies"].values() for line in lines] + PROJECT["dependencies"]
    names = {re.split(r"[<>=~!\[]", line)[0] for line in named} - {"surveilnav"}
    canonical = {re.sub(r"[-_.]+", "-", name).lower() for name in pinned}
    assert {name for name in names if re.sub(r"[-_.]+", "-", name).lower() not in canonical} == set()


def test_hooks_run_the_tools_of_the_environment():
    """So that ruff has one version, said in constraints.txt."""
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8"))
    assert [repo["repo"] for repo in config["repos"]] == ["local"]
    hooks = config["repos"][0]["hooks"]
    assert {(hook["language"], hook["entry"].split("/")[0]) for hook in hooks} == {("system", ".venv")}


@pytest.mark.parametrize("form", sorted((ROOT / ".github/ISSUE_TEMPLATE").glob("*.yml")), ids=lambda path: path.name)
def test_issue_forms_have_what_github_asks_for(form):
    read = yaml.safe_load(form.read_text(encoding="utf-8"))
    if form.name == "config.yml":
        assert {key for link in read["contact_links"] for key in link} == {"name", "url", "about"}
        return
    assert {"name", "description", "body"} <= set(read)
    ids = [field["id"] for field in read["body"]]
    assert len(set(ids)) == len(ids)
    assert all(field["attributes"]["label"] for field in read["body"])
