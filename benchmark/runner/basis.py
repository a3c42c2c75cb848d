"""What a run's numbers stand on besides its settings: the dataset, and what the program does."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import NamedTuple

from surveilnav.benchmark.canary import digest
from surveilnav.benchmark.dataset.integrity import damage, read_manifest
from surveilnav.benchmark.dataset.load import scenes_of
from surveilnav.errors import ConfigError


class Basis(NamedTuple):
    """A run's folder takes searches of one basis only.

    ``dataset``: a hash of the split's files. ``program``: the digest of the golden run (``surveilnav.benchmark.canary``): two
    versions of the program that search alike have the same, however they are written.
    """

    dataset: str
    program: str


def basis_of(root: Path, split: str) -> Basis:
    """What a search of a split is played on.

    Raises:
        ConfigError: there is no such dataset, or a file of it isn't what its manifest says.
    """
    manifest = read_manifest(root)
    scenes_of(root, split)  # refuses a split that the dataset hasn't
    for name, what in damage(root, manifest, split):
        raise ConfigError(
            f"{root / name} {what}: `surveilnav dataset check` names all that is wrong, `build` mends it or says what to delete"
        )
    mine = sorted((k, v) for k, v in manifest.sha256.items() if k.startswith(f"{split}/"))
    return Basis(hashlib.sha256(repr(mine).encode()).hexdigest(), digest())
