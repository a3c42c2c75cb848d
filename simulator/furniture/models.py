"""Furniture models as they lie in archives: geometry and materials, parsed once and kept in the cache."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError
from surveilnav.simulator.archive import MAX_TEXTURE_PX, decode_picture
from surveilnav.simulator.furniture.objfile import MtlMaterial, ObjModel, read_mtl, read_obj
from surveilnav.simulator.world.assembly import Mesh
from surveilnav.simulator.world.scene import Material
from surveilnav.storage import atomic_write

#: Part of the cache's file names: raise it whenever parsing changes.
CACHE_VERSION = 3

#: Leaves are pictures with holes; a triangle is cut into at most 4**this pieces to follow the outline.
_CUT_LEVELS = 4
_MAX_CUT_TRIANGLES = 60_000

Reader = Callable[[str], "bytes | None"]
_ARRAYS = ("vertices", "triangles", "uvs", "material", "group")


@dataclass(frozen=True, slots=True, eq=False)
class Model(Mesh):
    """A model in its own frame (y up, any unit).

    ``group``: (F,) int32 into ``group_names``, the names that the file gives to its parts.
    """

    group: NDArray[np.int32]
    group_names: tuple[str, ...]

    def chosen(self, keep: NDArray[np.bool_]) -> Model:
        """The triangles to ``keep`` (F,); vertices stay, used or not."""
        arrays = {name: getattr(self, name)[keep] for name in ("triangles", "uvs", "material", "group")}
        return replace(self, **arrays)

    def without_groups(self, drop: Callable[[str], bool]) -> Model:
        """The model without the triangles of the groups that ``drop`` names."""
        dropped = np.array([drop(name) for name in self.group_names], dtype=bool)
        return self.chosen(~dropped[self.group])


@lru_cache(maxsize=1)
def builtin_materials() -> dict[str, MtlMaterial]:
    """Java 3D's named materials, which OBJ files without an MTL use."""
    text = resources.files("surveilnav.simulator.furniture").joinpath("data/java3d_materials.json").read_text("utf-8")
    table: dict[str, dict] = json.loads(text)["materials"]
    return {
        name.lower(): MtlMaterial(color=(v["Kd"][0], v["Kd"][1], v["Kd"][2]), alpha=v["d"]) for name, v in table.items()
    }


def load_model(
    path: str, read: Reader, cache_file: Path | None = None, *, max_texture_px: int = MAX_TEXTURE_PX
) -> Model:
    """Reads an OBJ with its MTL and pictures.

    Args:
        path: of the OBJ in the archive.
        read: gives the bytes of a path in the archive, or None.
        cache_file: where the parsed model is kept, if anywhere. Only for archives that we trust.
        max_texture_px: pictures are reduced to this width and height.

    Raises:
        BuildingError: not there, or not an OBJ that can be read.
    """
    if cache_file is not None:
        cached = _load_cached(cache_file)
        if cached is not None:
            return cached
    if PurePosixPath(path).suffix.lower() not in (".obj", ""):
        raise BuildingError(f"{path[:80]!r} is no OBJ file: models in other formats can't be read")
    data = read(path)
    if data is None:
        raise BuildingError(f"there is no model {path!r}")
    obj = read_obj(data, path)
    model = _with_materials(obj, path, read, max_texture_px)
    if cache_file is not None:
        _save_cached(cache_file, model)
    return model


def _with_materials(obj: ObjModel, path: str, read: Reader, max_texture_px: int) -> Model:
    folder = PurePosixPath(path).parent
    known: dict[str, MtlMaterial] = {}
    for library in obj.libraries:
        name = library.replace("\\", "/").rsplit("/", 1)[-1]
        data = read(str(folder / name))
        if data is not None:
            known.update({key.lower(): value for key, value in read_mtl(data).items()})
    builtin = builtin_materials()
    pictures: dict[str, tuple[NDArray[np.uint8], NDArray[np.uint8] | None] | None] = {}
    materials: list[Material] = []
    cuts: dict[int, NDArray[np.uint8]] = {}
    for index, name in enumerate(obj.material_names):
        mtl = known.get(name.lower()) or builtin.get(name.lower()) or MtlMaterial()
        texture = None
        if mtl.texture:
            if mtl.texture not in pictures:
                pictures[mtl.texture] = _picture(mtl.texture, folder, read, max_texture_px)
            picture = pictures[mtl.texture]
            if picture is not None:
                texture = picture[0]
                if picture[1] is not None:
                    cuts[index] = picture[1]
        # A picture keeps its own colours: many MTL files give Kd 0 beside one.
        color = (1.0, 1.0, 1.0) if texture is not None else mtl.color or (0.8, 0.8, 0.8)
        materials.append(Material(name, color, texture, mtl.alpha, mtl.shininess / 128.0))
    model = Model(obj.vertices, obj.triangles, obj.uvs, obj.material, tuple(materials), obj.group, obj.group_names)
    for index, alpha in cuts.items():
        model = _cut_out(model, index, alpha)
    return model


def _picture(
    words: str, folder: PurePosixPath, read: Reader, max_px: int
) -> tuple[NDArray[np.uint8], NDArray[np.uint8] | None] | None:
    """The picture that a ``map_Kd`` line means: options before it, backslashes and spaces in it are all met."""
    plain = words.replace("\\", "/")
    candidates = [plain]
    if plain.startswith("-"):
        candidates.append(plain.split()[-1])
    for candidate in candidates:
        for name in (candidate, candidate.rsplit("/", 1)[-1]):
            if name.startswith("/") or ".." in name:
                continue
            data = read(str(folder / name))
            if data:
                return decode_picture(data, max_px)
    return None


def _cut_out(model: Model, material: int, alpha: NDArray[np.uint8]) -> Model:
    """The model with the transparent parts of one picture cut away, triangle by triangle."""
    chosen = np.flatnonzero(model.material == material)
    corners, uv, group = _opaque_parts(
        model.vertices[model.triangles[chosen]].astype(np.float64),
        model.uvs[chosen].astype(np.float64),
        model.group[chosen],
        alpha,
    )
    rest = model.chosen(model.material != material)
    triangles = len(model.vertices) + np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3)
    return replace(
        rest,
        vertices=np.concatenate([rest.vertices, corners.reshape(-1, 3).astype(np.float32)]),
        triangles=np.concatenate([rest.triangles, triangles]),
        uvs=np.concatenate([rest.uvs, uv.astype(np.float32)]),
        material=np.concatenate([rest.material, np.full(len(triangles), material, np.int32)]),
        group=np.concatenate([rest.group, group]),
    )


_Parts = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int32]]


def _opaque_parts(
    corners: NDArray[np.float64], uv: NDArray[np.float64], group: NDArray[np.int32], alpha: NDArray[np.uint8]
) -> _Parts:
    """Corners (n, 3, 3), texture coordinates (n, 3, 2) and groups (n,) of what is opaque, quartered where it is partly."""
    done: list[_Parts] = []
    for level in range(_CUT_LEVELS + 1):
        if len(uv) == 0:
            break
        opaque = _opaque_samples(uv, alpha)
        if level == _CUT_LEVELS or 4 * len(uv) > _MAX_CUT_TRIANGLES:
            mostly = opaque.mean(axis=1) >= 0.5
            done.append((corners[mostly], uv[mostly], group[mostly]))
            break
        # A large triangle may hide a hole between seven samples: never settle on the first level.
        full, empty = opaque.all(axis=1) & (level > 0), ~opaque.any(axis=1) & (level > 0)
        done.append((corners[full], uv[full], group[full]))
        rest = ~full & ~empty
        corners, uv, group = _quartered(corners[rest]), _quartered(uv[rest]), np.repeat(group[rest], 4)
    corners, uv, group = (np.concatenate(arrays) for arrays in zip(*done, strict=True))
    return corners, uv, group


def _opaque_samples(uv: NDArray[np.float64], alpha: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """(n, 7) whether the picture is opaque at seven places of each triangle."""
    inner = np.array([[4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 2], [3, 3, 0], [0, 3, 3], [3, 0, 3]]) / 6.0
    height, width = alpha.shape
    samples = np.einsum("sk,nkc->nsc", inner, uv)
    col = np.floor((samples[..., 0] % 1.0) * width).astype(int) % width
    row = np.floor(((1.0 - samples[..., 1]) % 1.0) * height).astype(int) % height
    return np.asarray(alpha[row, col] >= 128)


def _quartered(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each triangle (n, 3, c) cut into four (4n, 3, c) at the middles of its sides."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    parts = np.stack([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))], axis=1)
    return parts.reshape(-1, 3, corners.shape[2])


def _save_cached(path: Path, model: Model) -> None:
    """Keeps a parsed model; a full or read-only disk only costs time."""
    meta = {
        "groups": model.group_names,
        "materials": [(m.name, m.color, m.alpha, m.shininess, m.texture is not None) for m in model.materials],
    }
    arrays: dict[str, NDArray] = {name: getattr(model, name) for name in _ARRAYS}
    arrays["meta"] = np.frombuffer(json.dumps(meta).encode(), np.uint8)
    for index, m in enumerate(model.materials):
        if m.texture is not None:
            arrays[f"texture_{index}"] = m.texture
    try:
        with atomic_write(path) as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
    except OSError:
        return


def _load_cached(path: Path) -> Model | None:
    """A model from the cache; None where there is none or it is damaged (it is parsed again then)."""
    try:
        with np.load(path, allow_pickle=False) as stored:
            meta = json.loads(stored["meta"].tobytes())
            materials = tuple(
                Material(
                    name, (color[0], color[1], color[2]), stored[f"texture_{i}"] if has else None, alpha, shininess
                )
                for i, (name, color, alpha, shininess, has) in enumerate(meta["materials"])
            )
            arrays = {name: stored[name] for name in _ARRAYS}
            return Model(**arrays, materials=materials, group_names=tuple(meta["groups"]))
    except (OSError, ValueError, KeyError, IndexError, TypeError, EOFError, zipfile.BadZipFile):
        return None
