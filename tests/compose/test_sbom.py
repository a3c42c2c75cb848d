"""The bill of materials that `make sbom` writes of an image."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator

from tests.compose.stack import UP_S, missing

ROOT = Path(__file__).parents[2]
_SPEC = importlib.util.spec_from_file_location("sbom", ROOT / "tools/sbom.py")
assert _SPEC is not None
assert _SPEC.loader is not None
sbom = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(sbom)


def versions(text: str) -> dict[str, str]:
    """Versions by the name and kind of package: "pypi/numpy", "deb/debian/libc6"."""
    components = json.loads(text)["components"]
    purls = [c["purl"].removeprefix("pkg:").partition("@") for c in components if "purl" in c]
    return {name: version.partition("?")[0] for name, _, version in purls}


def test_the_inventory_of_this_environment_becomes_a_valid_file():
    said = subprocess.run(
        [sys.executable, "-"], input=sbom.INVENTORY, capture_output=True, text=True, check=True
    ).stdout
    text = sbom.as_json(sbom.bom_of("test", json.loads(said)))
    assert JsonStrictValidator(SchemaVersion.V1_6).validate_str(text) is None
    listed = versions(text)
    for name in ("numpy", "eclipse-zenoh", "surveilnav"):
        assert listed[f"pypi/{name}"] == importlib.metadata.version(name)
    licences = {c["name"]: json.dumps(c.get("licenses")) for c in json.loads(text)["components"]}
    assert "BSD-3-Clause" in licences["numpy"]
    assert "Apache" in licences["eclipse-zenoh"]


def test_a_file_that_the_schema_forbids_is_not_written():
    bom = sbom.bom_of("test", {"python": {}, "debian": [], "interpreter": "3.11", "furniture": False})
    assert sbom.as_json(bom)
    bom.version = 0
    with pytest.raises(ValueError, match="not a CycloneDX file"):
        sbom.as_json(bom)


@pytest.mark.compose
@pytest.mark.slow
@pytest.mark.timeout(UP_S)
def test_an_image_holds_exactly_what_is_locked():
    if why := missing():
        pytest.skip(f"no Docker engine with Compose v2 here ({why})")
    subprocess.run(["docker", "compose", "--progress", "quiet", "build", "router"], cwd=ROOT, check=True, timeout=UP_S)
    listed = versions(sbom.as_json(sbom.bom_of("surveilnav", sbom.inventory_of("surveilnav"))))
    lock = (ROOT / "requirements/services.txt").read_text(encoding="utf-8")
    locked = {re.sub(r"[-_.]+", "-", n).lower(): v for n, v in re.findall(r"^([\w.-]+)==(\S+)", lock, re.MULTILINE)}
    found = {re.sub(r"[-_.]+", "-", name): version for name, version in listed.items()}  # an inventory keeps dots
    assert {name: found.get(f"pypi/{name}") for name in locked} == locked
    assert listed["pypi/surveilnav"]
    assert "pypi/torch" not in listed
    assert "pypi/open3d-cpu" not in listed
    assert any(name.startswith("deb/debian/") for name in listed)
