"""Writes what an image contains as a CycloneDX file: ``python tools/sbom.py surveilnav surveilnav-simulation``.

``make sbom`` runs it on the images that Compose has built; the files land in build/sbom. An image is asked itself: its Python
says which packages it finds, and its Debian which it has installed. Nothing needs to be in the image for that.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
from packageurl import PackageURL

FOLDER = Path("build/sbom")
#: Runs in the image, with nothing but Python's standard library: prints its packages as JSON.
INVENTORY = """
import importlib.metadata as md, json, pathlib, platform, subprocess

def licence(meta):
    if meta.get("License-Expression"):
        return meta["License-Expression"]
    classified = [c.split(" :: ")[-1] for c in meta.get_all("Classifier") or [] if c.startswith("License :: ")]
    named = (meta.get("License") or "").strip()
    return named if named and len(named) <= 64 and "\\n" not in named else ", ".join(classified)

python = {d.metadata["Name"]: [d.version, licence(d.metadata)] for d in reversed(list(md.distributions())) if d.metadata["Name"]}
debian = []
if pathlib.Path("/var/lib/dpkg/status").exists():
    shown = "${db:Status-Abbrev}\\t${Package}\\t${Version}\\t${Architecture}\\n"
    rows = subprocess.run(["dpkg-query", "-W", "-f", shown], capture_output=True, text=True, check=True).stdout
    debian = [row.split("\\t")[1:] for row in rows.splitlines() if row.startswith("ii")]
furniture = pathlib.Path("/var/cache/surveilnav/assets/sweethome3d").exists()
print(json.dumps({"python": python, "debian": debian, "interpreter": platform.python_version(), "furniture": furniture}))
"""


def inventory_of(image: str) -> dict[str, Any]:
    """What an image says of itself. Exits with an error if there is no such image."""
    command = ["docker", "run", "--rm", "--interactive", "--network", "none", "--entrypoint", "python", image, "-"]
    done = subprocess.run(command, input=INVENTORY, capture_output=True, text=True)
    if done.returncode:
        sys.exit(
            f"sbom: {image} can't be asked ({done.stderr.strip().splitlines()[-1:]}): `docker compose build` makes it"
        )
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def bom_of(image: str, inventory: dict[str, Any]) -> Bom:
    """The bill of materials of an image's inventory, as ``INVENTORY`` prints it."""
    bom, licences = Bom(), LicenseFactory()
    bom.metadata.component = Component(name=image, type=ComponentType.CONTAINER, bom_ref=image)
    interpreter = inventory["interpreter"]
    bom.components.add(
        Component(name="python", version=interpreter, purl=PackageURL("generic", None, "python", interpreter))
    )
    for name, (version, licence) in inventory["python"].items():
        purl = PackageURL("pypi", None, name.lower().replace("_", "-"), version)
        named = [licences.make_from_string(licence)] if licence else []
        bom.components.add(Component(name=name, version=version, purl=purl, bom_ref=str(purl), licenses=named))
    for name, version, architecture in inventory["debian"]:
        purl = PackageURL("deb", "debian", name, version, {"arch": architecture})
        bom.components.add(Component(name=name, version=version, purl=purl, bom_ref=str(purl)))
    if inventory["furniture"]:
        text = "homes and furniture, unpacked from Debian's packages sweethome3d and sweethome3d-furniture"
        bom.components.add(Component(name="sweethome3d", type=ComponentType.DATA, description=text))
    bom.register_dependency(bom.metadata.component, bom.components)
    return bom


def as_json(bom: Bom) -> str:
    """The file's text. Raises ValueError if it doesn't meet CycloneDX' schema."""
    text = JsonV1Dot6(bom).output_as_string(indent=1)
    if error := JsonStrictValidator(SchemaVersion.V1_6).validate_str(text):
        raise ValueError(f"not a CycloneDX file: {str(error)[:500]}")
    return text


def main() -> None:
    """Writes a file for each image that is named on the command line."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for image in sys.argv[1:]:
        bom = bom_of(image, inventory_of(image))
        path = FOLDER / f"{image.replace('/', '-').replace(':', '-')}.cdx.json"
        path.write_text(as_json(bom), encoding="utf-8")
        print(f"{path}: {len(bom.components)} components")


if __name__ == "__main__":
    main()
