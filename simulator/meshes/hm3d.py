"""HM3D's folder of a scene: ``00800-XXXX/XXXX.{glb, semantic.glb, semantic.txt}``.

The semantic GLB is the same building painted with one colour per thing; the text says what each colour is. Its mesh may
be cut otherwise than the plain one, so colours go over by place: each plain triangle takes the colour at the point of
the painted surface that is nearest to its middle.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import open3d.core as o3c
from numpy.typing import NDArray
from open3d.t.geometry import RaycastingScene
from scipy.spatial import cKDTree

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes.buildings import building_of, scene_name
from surveilnav.simulator.meshes.gltf import read_glb
from surveilnav.simulator.meshes.layout import stem_of
from surveilnav.simulator.meshes.names import label_of_hm3d
from surveilnav.simulator.meshes.things import MeshPart
from surveilnav.simulator.world.assembly import Mesh
from surveilnav.simulator.world.scene import Scene

_EXACT_PX = 16_384
_MAX_ROWS = 65_000
#: Nearer than this two triangles' middles are the same triangle; a painted surface further off than _FAR_M is another.
_SAME_M, _FAR_M = 1e-3, 0.1
_ROW = re.compile(r"[0-9A-Fa-f]{6}")


@dataclass(frozen=True, slots=True)
class Annotation:
    """A row of the text: id, colour 0xRRGGBB, raw name, region."""

    id: int
    color: int
    name: str
    region: int


def open_hm3d(path: Path) -> Scene:
    """The building of an HM3D folder (or of a GLB in it): things are named as HM3D's annotators did ("chair 12").

    Without the semantic files it has no things; a note says so.

    Raises:
        BuildingError: no plain GLB there, or a file can't be read.
    """
    folder = path if path.is_dir() else path.parent
    stem = stem_of(folder)
    if stem is None:
        raise BuildingError(f"{folder} is no scene of HM3D: expected 00800-XXXX with XXXX.glb and XXXX.semantic.txt")
    plain = folder / f"{stem}.glb"
    if not plain.exists():
        plain = folder / f"{stem}.basis.glb"
    if not plain.exists():
        raise BuildingError(f"{folder} has no {stem}.glb: take it from HM3D's *-glb-v0.2 tar")
    glb = read_glb(plain)
    meshes = [node.mesh for node in glb.meshes]
    notes = list(glb.notes)
    painted, text = folder / f"{stem}.semantic.glb", folder / f"{stem}.semantic.txt"
    if painted.exists() and text.exists():
        rows, about = read_annotations(text)
        colors, seen = _colors_of(meshes, painted)
        pieces, more = _pieces(meshes, rows, colors)
        notes += [*about, *seen, *more]
    else:
        missing = " and ".join(p.name for p in (painted, text) if not p.exists())
        pieces = [MeshPart("building", "", tuple(meshes))]
        notes.append(
            f"{missing} isn't there: nothing in the building has a name (HM3D: the *-semantic-annots-v0.2 tar)"
        )
    return building_of(pieces, scene_name(folder.name), f"HM3D scene {folder.name}", notes)


def read_annotations(path: Path) -> tuple[list[Annotation], list[str]]:
    """The rows of a semantic.txt, and notes on those that can't be read.

    Raises:
        BuildingError: none can be read.
    """
    rows: dict[int, Annotation] = {}
    bad: list[str] = []
    lines = path.read_text("utf-8", errors="replace").splitlines()
    for line in lines[1:] if lines and lines[0].startswith("HM3D") else lines:
        if not line.strip():
            continue
        try:
            number, color, name, region = next(csv.reader([line]))
            if not _ROW.fullmatch(color.strip()):
                raise ValueError(color)
            row = Annotation(int(number), int(color, 16), name.strip(), int(region))
        except (ValueError, StopIteration, csv.Error):
            bad.append(line)
            continue
        if row.color in rows or len(rows) >= _MAX_ROWS:
            bad.append(line)
        else:
            rows[row.color] = row
    if not rows:
        raise BuildingError(
            f"{path} has no row that can be read: expected 'HM3D Semantic Annotations', then lines like "
            "'1,A8FFC4,\"chair\",3' (number, colour, name, region)"
        )
    notes = (
        [f"{path.name}: {len(bad)} rows can't be read or name a colour twice, the first {bad[0][:60]!r}"] if bad else []
    )
    return list(rows.values()), notes


def _pieces(
    meshes: list[Mesh], rows: list[Annotation], colors: list[NDArray[np.int64]]
) -> tuple[list[MeshPart], list[str]]:
    """One piece per annotated thing that has triangles, and one of all the rest."""
    parts: dict[int, list[Mesh]] = {}
    unlisted: Counter[int] = Counter()
    known = {row.color: row for row in rows}
    for mesh, color in zip(meshes, colors, strict=True):
        for value in np.unique(color).tolist():
            chosen = color == value
            if value > 0 and value not in known:
                unlisted[value] += int(chosen.sum())
            parts.setdefault(value if value in known else -1, []).append(mesh.part(chosen))
    pieces = [
        MeshPart(f"{row.name} {row.id}", label_of_hm3d(row.name), tuple(parts[row.color]), f"region {row.region}")
        for row in rows
        if row.color in parts
    ]
    if -1 in parts:
        pieces.append(MeshPart("not annotated", "", tuple(parts[-1])))
    notes = []
    if unlisted:
        notes.append(
            f"{len(unlisted)} colours ({sum(unlisted.values())} triangles) aren't in the text, the first "
            f"{next(iter(unlisted)):06X}: those triangles have no name"
        )
    if absent := sum(row.color not in parts for row in rows):
        notes.append(f"{absent} of {len(rows)} annotated things have no triangle of their own")
    return pieces, notes


def _colors_of(meshes: list[Mesh], painted: Path) -> tuple[list[NDArray[np.int64]], list[str]]:
    """0xRRGGBB of every triangle (F,) of every mesh; -1 where no painted surface is near."""
    semantic = read_glb(painted, max_texture_px=_EXACT_PX)
    if not semantic.meshes:
        raise BuildingError(f"{painted} has no triangles: it is damaged")
    corners = np.concatenate([n.mesh.vertices[n.mesh.triangles] for n in semantic.meshes])
    middles = cKDTree(corners.mean(axis=1))
    surface = RaycastingScene(nthreads=0)
    surface.add_triangles(
        o3c.Tensor(np.ascontiguousarray(corners.reshape(-1, 3), np.float32)),
        o3c.Tensor(np.arange(3 * len(corners), dtype=np.uint32).reshape(-1, 3)),
    )
    found = []
    strayed = 0
    for mesh in meshes:
        p = mesh.vertices[mesh.triangles].mean(axis=1)
        away, triangle = middles.query(p, workers=-1)
        weights = np.full((len(p), 3), 1 / 3)
        other = np.flatnonzero(away > _SAME_M)  # cut otherwise: the nearest point of the painted surface
        if len(other):
            nearest = surface.compute_closest_points(o3c.Tensor(np.ascontiguousarray(p[other], np.float32)))
            triangle[other] = nearest["primitive_ids"].numpy()
            uv = nearest["primitive_uvs"].numpy()
            weights[other] = np.column_stack([1 - uv.sum(axis=1), uv])
            away[other] = np.linalg.norm(nearest["points"].numpy() - p[other], axis=1)
        color = _sampled([n.mesh for n in semantic.meshes], triangle, weights)
        color[away > _FAR_M] = -1
        strayed += int((away > _FAR_M).sum())
        found.append(color)
    notes = list(semantic.notes)
    if strayed:
        notes.append(f"{strayed} triangles lie {_FAR_M} m or more from the annotated surface: they have no name")
    return found, notes


def _sampled(meshes: list[Mesh], triangle: NDArray[np.int64], weights: NDArray[np.float64]) -> NDArray[np.int64]:
    """0xRRGGBB (N,) of the picture at points of triangles, counted over all meshes; nearest texel, no filter."""
    first = np.cumsum([0, *(len(m.triangles) for m in meshes)])
    owner = np.searchsorted(first, triangle, side="right") - 1
    color = np.zeros(len(triangle), np.int64)
    for number in np.unique(owner).tolist():
        mine = owner == number
        mesh = meshes[number]
        local = triangle[mine] - first[number]
        texture = mesh.materials[0].texture
        if texture is None:
            rgb = np.broadcast_to(np.round(np.array(mesh.materials[0].color) * 255).astype(np.int64), (mine.sum(), 3))
        else:
            uv = np.einsum("nk,nkc->nc", weights[mine], mesh.uvs[local].astype(np.float64)) % 1.0
            height, width = texture.shape[:2]
            col = np.minimum((uv[:, 0] * width).astype(int), width - 1)
            row = np.clip(((1.0 - uv[:, 1]) * height).astype(int), 0, height - 1)
            rgb = texture[row, col].astype(np.int64)
        color[mine] = rgb @ np.array([1 << 16, 1 << 8, 1])
    return color
