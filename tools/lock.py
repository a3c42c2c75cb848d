"""Writes requirements/*.txt: what the images install, with the hashes of all files that the package index has of each version.

``make lock`` runs it. Which packages there are follows from pyproject.toml, their versions from constraints.txt. An image that
is built on another has a file with only what it adds.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Extras by image; each image is built on the first.
EXTRAS = {
    "services": ("services",),
    "simulation": ("simulator", "mesh"),
    "gpu": ("perception-torch", "mobile-sam"),
}
#: What builds our own package inside the image's build.
BUILD = "build"
_HEADER = "# Made by `make lock` from pyproject.toml and constraints.txt; don't edit.\n"


def entries(lock: str) -> dict[str, str]:
    """The requirements of a lock by the package's name, each with its hashes."""
    found = re.findall(r"^[A-Za-z0-9].*(?:(?<=\\)\n.*)*", lock, re.MULTILINE)
    return {re.split(r"[=\s]", entry, maxsplit=1)[0]: entry for entry in found}


def compile_lock(uv: Path, source: Path, extras: tuple[str, ...] = ()) -> dict[str, str]:
    """What a pyproject.toml or a requirements file comes to, on Debian 12 with the Python of the images."""
    command = [uv, "pip", "compile", source, "--constraints", ROOT / "constraints.txt", "--generate-hashes"]
    command += ["--python-version", "3.11", "--python-platform", "x86_64-manylinux_2_36"]
    command += ["--quiet", "--no-config", "--no-annotate", "--no-header"]
    command += [word for extra in extras for word in ("--extra", extra)]
    return entries(subprocess.run(command, check=True, capture_output=True, text=True, cwd=ROOT).stdout)


def write(name: str, lock: dict[str, str]) -> None:
    path = ROOT / "requirements" / f"{name}.txt"
    path.parent.mkdir(exist_ok=True)
    path.write_text(_HEADER + "".join(f"{entry}\n" for entry in lock.values()), encoding="utf-8")
    print(f"{path.relative_to(ROOT)}: {len(lock)} packages")


def main() -> None:
    """Makes a throw-away environment with uv, and the locks by it."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        pip = [f"{folder}/bin/python", "-m", "pip", "install", "-qq", "--disable-pip-version-check"]
        subprocess.run([*pip, "-c", ROOT / "constraints.txt", "uv"], check=True)
        uv = Path(folder) / "bin/uv"
        build = Path(folder) / "build.in"
        build.write_text("hatchling\n", encoding="utf-8")
        write(BUILD, compile_lock(uv, build))
        locks = {name: compile_lock(uv, ROOT / "pyproject.toml", extras) for name, extras in EXTRAS.items()}
    first = next(iter(locks.values()))
    for name, lock in locks.items():
        write(name, {k: entry for k, entry in lock.items() if lock is first or k not in first})


if __name__ == "__main__":
    main()
