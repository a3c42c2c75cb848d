"""Which program this is, to the byte: what it made is worth keeping only for the same program."""

from __future__ import annotations

import hashlib
from functools import cache
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

#: What else decides pixels and answers.
_LIBRARIES = ("numpy", "opencv-python-headless", "onnxruntime", "torch")
_KINDS = (".py", ".json", ".txt", ".onnx")
#: Parts of the package ``surveilnav`` that aren't the library: they are named by themselves.
_APART = {"services", "simulator", "benchmark", "cli"}


@cache
def code_fingerprint(*packages: str) -> str:
    """A hash of the files of packages ("surveilnav" is the library alone), and of the versions of the
    libraries that compute for them.

    Raises:
        ModuleNotFoundError: there is no such package.
    """
    whole = hashlib.sha256()
    for package in packages:
        spec = find_spec(package)
        if spec is None or not spec.submodule_search_locations:
            raise ModuleNotFoundError(f"expected the name of a package, got {package!r}")
        folder = Path(spec.submodule_search_locations[0])
        for file in sorted(path for path in folder.rglob("*") if path.suffix in _KINDS):
            if package == "surveilnav" and file.relative_to(folder).parts[0] in _APART:
                continue
            whole.update(f"{package} {file.relative_to(folder)} {file.stat().st_size} ".encode())
            whole.update(file.read_bytes())
    for name in _LIBRARIES:
        whole.update(f"{name} {_version(name)} ".encode())
    return whole.hexdigest()


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "not here"
