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


_LOCKS = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "requirements").glob("*.txt")}


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def _locked(lock: str) -> dict[str, str]:
    """Versions by name."""
    return {_canonical(name): version for name, version in re.findall(r"^([\w.-]+)==(\S+)", lock, re.MULTILINE)}


@pytest.mark.parametrize("image", sorted(_LOCKS))
def test_what_an_image_installs_has_the_versions_of_the_constraints_and_hashes(image):
    """`make lock` was run after the last change of constraints.txt."""
    rows = [line for line in (ROOT / "constraints.txt").read_text().splitlines() if "==" in line]
    pinned = {_canonical(name): version for name, _, version in (row.partition("==") for row in rows)}
    locked = _locked(_LOCKS[image])
    assert locked == {name: pinned.get(name) for name in locked}
    entries = re.findall(r"^[\w.-]+==.*(?:(?<=\\)\n.*)*", _LOCKS[image], re.MULTILINE)
    assert len(entries) == len(locked)
    assert all(re.search(r"--hash=sha256:[0-9a-f]{64}", entry) for entry in entries)
    others = [line for line in _LOCKS[image].splitlines() if not re.match(r"[\w.-]+==|    --hash=sha256:|#", line)]
    assert others == [], "such as the address of an index"


def test_every_image_installs_what_its_extras_name():
    """`make lock` was run after the last change of pyproject.toml."""
    assert set(_LOCKS) == {"build", "services", "simulation", "gpu"}
    services = _locked(_LOCKS["services"])
    extras = PROJECT["optional-dependencies"]
    for image, named in {
        "services": ["services"],
        "simulation": ["services", "simulator", "mesh"],
        "gpu": ["services", "perception-torch", "mobile-sam"],
    }.items():
        wanted = PROJECT["dependencies"] + [row for extra in named for row in extras[extra]]
        names = {_canonical(re.split(r"[<>=~!\[]", row)[0]) for row in wanted} - {"surveilnav"}
        own = _locked(_LOCKS[image])
        assert names <= services.keys() | own.keys()
        assert image == "services" or not services.keys() & own.keys(), "what an image adds to another's packages"


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
