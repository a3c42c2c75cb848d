"""A fingerprint of the program's code, as part of cache keys: another version of the code must not use cached results."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

#: Libraries that influence results.
_LIBRARIES = ("numpy", "opencv-python-headless", "onnxruntime", "torch")
_KINDS = (".py", ".json", ".txt", ".onnx")
#: Parts of the package ``surveilnav`` that don't belong to the library. They have to be named separately.
_NOT_LIBRARY = {"services", "simulator", "benchmark", "cli"}


@cache
def code_fingerprint(*packages: str) -> str:
    """A hash of the files of packages, and of the versions of the libraries that they compute with.

    "surveilnav" stands for the library only, without its services, simulator, benchmark and command line.

    Raises:
        ModuleNotFoundError: there is no such package.
    """
    digest = hashlib.sha256()
    for package in packages:
        spec = find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            raise ModuleNotFoundError(f"expected the name of a package, got {package!r}")
        folder = Path(spec.submodule_search_locations[0])
        for file in sorted(path for path in folder.rglob("*") if path.suffix in _KINDS):
            if package == "surveilnav" and file.relative_to(folder).parts[0] in _NOT_LIBRARY:
                continue
            digest.update(f"{package} {file.relative_to(folder)} {file.stat().st_size} ".encode())
            digest.update(file.read_bytes())
    for name in _LIBRARIES:
        digest.update(f"{name} {_version(name)} ".encode())
    return digest.hexdigest()


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not here"
