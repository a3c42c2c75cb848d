"""Putting furniture into its place: which model, how it fills its box, where it stands."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import resources
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from surveilnav.simulator.furniture.catalog import CatalogModel, Furniture, stretch
from surveilnav.simulator.furniture.models import Model
from surveilnav.simulator.plans.sweethome import Piece
from surveilnav.simulator.world.assembly import Mesh
from surveilnav.simulator.world.scene import Material

#: Candidates that must be distorted this much more than the best one are not considered (factor e**0.2).
_STRETCH_SLACK = 0.2
#: A piece that even the best candidate fills only when distorted this much is used as something else: it stays.
_MAX_STRETCH = 0.75
_SMALL_PLANT_M = 0.36

#: Which models may furnish a building: all, or those of one half of every kind (``val`` in the table, or the others).
Models = Literal["all", "train", "val"]
MODELS: tuple[Models, ...] = get_args(Models)
#: Where a half is asked for and a piece of a target has no kind of its own.
_KIND_BY_LABEL = {
    "bed": "single bed",
    "couch": "sofa",
    "chair": "chair",
    "toilet": "toilet",
    "tv": "tv",
    "potted plant": "plant",
}


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of furniture that can be swapped: see ``data/furniture_kinds.json``."""

    name: str
    label: str
    fit: str
    models: tuple[str, ...]
    val: frozenset[str] = frozenset()

    def for_half(self, half: Models) -> tuple[str, ...]:
        """The models that may furnish that half; all where one half has none."""
        chosen = tuple(m for m in self.models if half == "all" or (m in self.val) == (half == "val"))
        return chosen or self.models


@lru_cache(maxsize=1)
def kinds() -> dict[str, Kind]:
    return {
        name: Kind(name, row["label"], row["fit"], tuple(row["models"]), frozenset(row["val"]))
        for name, row in _table()["kinds"].items()
    }


@lru_cache(maxsize=1)
def _table() -> dict:
    text = resources.files("surveilnav.simulator.furniture").joinpath("data/furniture_kinds.json").read_text("utf-8")
    result: dict = json.loads(text)
    return result


@lru_cache(maxsize=1)
def _kind_by_model() -> dict[str, str]:
    return {model: name for name, row in _table()["kinds"].items() for model in row["from"]}


def kind_of(catalog_id: str, size_m: tuple[float, float, float]) -> Kind | None:
    """The kind that a catalogue entry is swapped within, or None where it stays as it is."""
    name = _kind_by_model().get(catalog_id)
    width, depth, height = size_m
    if catalog_id in ("eTeks#squareTable", "eTeks#roundTable"):
        if height < 0.6 or max(width, depth) < 0.7:
            return None
        name = "table" if catalog_id == "eTeks#squareTable" else "round table"
    elif catalog_id == "eTeks#bedsideTable" and 0.35 <= height <= 0.7 and max(width, depth) <= 0.7:
        name = "bedside table"
    elif name in ("plant", "flowers") and height < _SMALL_PLANT_M:
        name = "small plant"
    elif name == "bunk bed" and width > depth:
        return None
    return kinds()[name] if name else None


def split_kind_of(catalog_id: str, label: str) -> Kind | None:
    """The kind that stands in for a target's piece that usually stays as it is, where a half is asked for."""
    name = _table()["stays"].get(catalog_id, _KIND_BY_LABEL.get(label, ""))
    return replace(kinds()[name], fit="inside") if name else None


def choose(
    kind: Kind, size_m: tuple[float, float, float], furniture: Furniture, key: str, half: Models = "all"
) -> tuple[CatalogModel, str] | None:
    """A model of that kind and half whose proportions suit, and how it fits; the same ``key`` always gives the same.

    None where the libraries have none that suits. A half never gives None for want of proportions: a model of the
    other half would stay in its place; it is fitted "inside" then.
    """
    never = set(_table()["never"])
    entries = [furniture.by_id[m] for m in kind.for_half(half) if m in furniture.by_id and m not in never]
    if not entries:
        return None
    if kind.fit in ("box", "inside"):
        costs = [stretch(e.size_m, size_m) for e in entries]
    elif kind.fit == "floor":
        costs = [stretch(e.size_m[:2], size_m[:2]) for e in entries]
    elif kind.fit == "height":
        # Wider than its place is worse than narrower: a plant must not grow into the wall.
        costs = [max(stretch((max(e.size_m[:2]), e.size_m[2]), (max(size_m[:2]), size_m[2])), 0.35) for e in entries]
    else:
        costs = [0.0] * len(entries)
    best = min(costs)
    if best > _MAX_STRETCH and half == "all":
        return None
    suitable = [e for e, cost in zip(entries, costs, strict=True) if cost <= best + _STRETCH_SLACK]
    return suitable[int(seeded(key).integers(len(suitable)))], kind.fit if best <= _MAX_STRETCH else "inside"


def seeded(key: str) -> np.random.Generator:
    """A generator that depends on the text alone, on every machine."""
    return np.random.default_rng(int.from_bytes(hashlib.blake2b(key.encode(), digest_size=8).digest(), "big"))


def fitted(piece: Piece, entry: CatalogModel, fit: str) -> Piece:
    """The piece with the box that ``entry``'s model takes within the piece's own."""
    w, d, h = piece.size_m
    mw, md, mh = entry.size_m
    if fit == "floor":
        return replace(piece, size_m=(w, d, mh * float(np.sqrt((w / mw) * (d / md)))))
    if fit == "height":
        scale = min(h / mh, 1.5 * max(w, d) / max(mw, md))
        return replace(piece, size_m=(mw * scale, md * scale, mh * scale))
    if fit == "back":
        scale = w / mw
        depth = min(d, md * scale)
        back = (d - depth) / 2
        c, s = np.cos(piece.yaw_rad), np.sin(piece.yaw_rad)
        return replace(
            piece,
            size_m=(w, depth, min(mh * scale, 1.0)),
            x_m=piece.x_m - float(s) * back,
            y_m=piece.y_m + float(c) * back,
        )
    if fit == "inside":
        scale = min(w / mw, d / md, 1.2)
        return replace(piece, size_m=(mw * scale, md * scale, mh * scale))
    return piece


def placed(
    model: Model,
    piece: Piece,
    rotation: tuple[float, ...] | None,
    z_floor_m: float,
    material: Callable[[int, Material], Material] | None = None,
) -> Mesh:
    """The model in the world, filling the piece's box as Sweet Home 3D places it.

    Turned by ``rotation`` (3x3, row-major), centred, scaled to width x height x depth (mirrored where asked), tilted
    by pitch or roll and centred again, turned about the vertical, and set on its elevation
    (``ModelManager.getPieceOfFurnitureNormalizedModelTransformation``). ``material`` may replace materials by index.
    """
    used = np.unique(model.triangles)
    p, height = _upright(model.vertices.astype(np.float64), used, piece, rotation)
    c, s = np.cos(piece.yaw_rad), np.sin(piece.yaw_rad)
    x, y, z = p[:, 0], -p[:, 2], p[:, 1]
    world = np.column_stack(
        [c * x - s * y + piece.x_m, s * x + c * y + piece.y_m, z + z_floor_m + piece.z_m + height / 2]
    )
    flips = piece.mirrored != (rotation is not None and np.linalg.det(np.reshape(rotation, (3, 3))) < 0)
    order = slice(None, None, -1) if flips else slice(None)
    table = np.full(len(p), -1, np.int32)
    table[used] = np.arange(len(used), dtype=np.int32)
    materials = model.materials if material is None else tuple(material(i, m) for i, m in enumerate(model.materials))
    return Mesh(
        world[used].astype(np.float32),
        np.ascontiguousarray(table[model.triangles][:, order]),
        np.ascontiguousarray(model.uvs[:, order]),
        model.material,
        materials,
    )


def _upright(
    p: NDArray[np.float64], used: NDArray[np.integer], piece: Piece, rotation: tuple[float, ...] | None
) -> tuple[NDArray[np.float64], float]:
    """A model's points (N, 3) [m, y up], the ``used`` ones in the piece's box around the origin, tilted; their height [m]."""
    if rotation is not None:
        p = p @ np.reshape(rotation, (3, 3)).T
    low, high = p[used].min(axis=0), p[used].max(axis=0)
    extent = np.where(high - low > 1e-9, high - low, 1.0)
    width, depth, height = (max(v, 1e-4) for v in piece.size_m)
    p = (p - (low + high) / 2) / extent * np.array([-width if piece.mirrored else width, height, depth])
    if piece.pitch_rad or piece.roll_rad:
        tilt = _about_x(-piece.pitch_rad) if piece.pitch_rad else _about_z(-piece.roll_rad)
        p = p @ tilt.T
        low, high = p[used].min(axis=0), p[used].max(axis=0)
        p = p - (low + high) / 2
        height = float(high[1] - low[1])
    return p, height


def _about_x(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _about_z(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
