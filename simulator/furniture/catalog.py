"""The furniture libraries: which models there are, what they are, how large, and whose."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import AssetError, BuildingError
from surveilnav.simulator.archive import Archive
from surveilnav.simulator.furniture.models import CACHE_VERSION, Model, load_model

#: Where the Debian packages put their files.
JAR = "usr/share/sweethome3d/sweethome3d.jar"
LIBRARIES = "usr/share/sweethome3d/furniture"
DEFAULT_CATALOG = "com/eteks/sweethome3d/io/DefaultFurnitureCatalog.properties"

#: Credit lines by archive (CREDITS.md has them in full).
CREDITS: dict[str, str] = {
    "sweethome3d": "Sweet Home 3D example homes and default furniture, eTeks: GNU GPL 2+ or CC BY 3.0",
    "Scopia": "furniture models by Scopia Visual Interfaces Systems: CC BY 3.0",
    "KatorLegaz": "furniture models by Andrew Kator and Jennifer Legaz: CC BY 3.0",
    "Reallusion": "furniture models by Reallusion: CC BY 3.0",
    "BlendSwap-CC-BY": "furniture models by Blend Swap contributors: CC BY 3.0",
    "BlendSwap-CC-0": "furniture models by Blend Swap contributors: CC0",
}

_LINE = re.compile(r"\s*(\w+)#(\d+)\s*=\s*(.*?)\s*$")
_ESCAPE = re.compile(r"\\u([0-9a-fA-F]{4})")
_WANTED = {"id", "name", "category", "model", "width", "depth", "height", "modelRotation"}


@dataclass(frozen=True, slots=True)
class CatalogModel:
    """One entry: ``size_m`` is width, depth, height; ``rotation`` turns the OBJ upright (3x3, row-major) or None."""

    id: str
    name: str
    category: str
    library: str
    path: str
    size_m: tuple[float, float, float]
    rotation: tuple[float, ...] | None


def parse_rotation(text: str | None) -> tuple[float, ...] | None:
    """Nine numbers of a ``modelRotation``; None where there are none or they are no rotation."""
    if not text:
        return None
    try:
        values = tuple(float(word) for word in text.split())
    except ValueError:
        return None
    if len(values) != 9 or not all(math.isfinite(v) for v in values):
        return None
    return values if abs(abs(np.linalg.det(np.reshape(values, (3, 3)))) - 1.0) < 0.1 else None


def read_properties(data: bytes) -> dict[str, dict[str, str]]:
    """The values by key of each numbered entry, by number; catalogues of all languages number them alike."""
    rows: dict[str, dict[str, str]] = {}
    for line in data.decode("latin-1").splitlines():
        match = _LINE.match(line)
        if match and match.group(1) in _WANTED:
            text = _ESCAPE.sub(lambda code: chr(int(code.group(1), 16)), match.group(3))
            rows.setdefault(match.group(2), {})[match.group(1)] = text
    return rows


def read_catalog(data: bytes, library: str) -> list[CatalogModel]:
    """The entries of a catalogue's properties file."""
    entries: list[CatalogModel] = []
    for row in read_properties(data).values():
        try:
            size = (float(row["width"]) / 100, float(row["depth"]) / 100, float(row["height"]) / 100)
            entries.append(
                CatalogModel(
                    row["id"],
                    row["name"],
                    row.get("category", ""),
                    library,
                    row["model"].lstrip("/"),
                    size,
                    parse_rotation(row.get("modelRotation")),
                )
            )
        except (KeyError, ValueError):
            continue
    return entries


class Furniture:
    """The models of the unpacked packages. Not thread-safe; close it after use (or use ``with``).

    Args:
        root: where the packages are unpacked (``assets.ensure_assets``).
        cache_dir: where parsed models are kept; None keeps none.
    """

    def __init__(self, root: Path, cache_dir: Path | None) -> None:
        self._cache_dir = cache_dir
        self._archives: dict[str, Archive] = {}
        self._models: dict[str, Model] = {}
        self.by_id: dict[str, CatalogModel] = {}
        try:
            self.jar = self._archives["sweethome3d"] = Archive(root / JAR)
            for path in sorted((root / LIBRARIES).glob("*.sh3f")):
                self._archives[path.stem] = Archive(path)
        except BuildingError as error:
            raise AssetError(
                f"the furniture libraries below {root} are damaged ({error}); delete {root} and try again"
            ) from error
        for library, archive in self._archives.items():
            name = DEFAULT_CATALOG if library == "sweethome3d" else "PluginFurnitureCatalog.properties"
            for entry in read_catalog(archive.read(name) or b"", library):
                self.by_id.setdefault(entry.id, entry)
        self._by_path = {entry.path.lower(): entry for entry in self.by_id.values()}

    def __enter__(self) -> Furniture:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        for archive in self._archives.values():
            archive.close()

    def find(self, catalog_id: str, path: str) -> CatalogModel | None:
        """The entry of that id, else the one whose model lies at ``path``."""
        return self.by_id.get(catalog_id) or self._by_path.get(path.lower().lstrip("/"))

    def load(self, entry: CatalogModel) -> Model:
        """The entry's model.

        Raises:
            BuildingError: it can't be read.
        """
        return self.load_path(entry.library, entry.path)

    def load_path(self, library: str, path: str) -> Model:
        key = f"{library}/{path}"
        if key not in self._models:
            archive = self._archives[library]
            self._models[key] = load_model(path, archive.read, self._cache_file(archive, path))
        return self._models[key]

    def _cache_file(self, archive: Archive, path: str) -> Path | None:
        fingerprint = archive.fingerprint(path)
        if self._cache_dir is None or not fingerprint:
            return None
        safe = re.sub(r"[^A-Za-z0-9_-]+", "_", path)[-80:]
        return self._cache_dir / f"models-{CACHE_VERSION}" / f"{archive.path.stem}-{safe}-{fingerprint}.npz"


def stretch(size_m: Sequence[float], target_m: Sequence[float]) -> float:
    """How much a size must be distorted to fill another: the spread of the logarithms of its three scales."""
    scales: NDArray[np.float64] = np.log(np.maximum(target_m, 1e-3)) - np.log(np.maximum(size_m, 1e-3))
    return float(scales.max() - scales.min())
