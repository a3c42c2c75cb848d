"""GLB files: geometry by trimesh, materials and pictures by our own readers.

We hand trimesh the file's header with materials, names and cameras replaced by numbers: what it gives back then leads
to the file's own nodes and materials, colours keep their precision, and pictures go through the same limits as
everybody's. No file beside the GLB is ever read.
"""

from __future__ import annotations

import io
import json
import math
import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes import draco
from surveilnav.simulator.meshes.materials import materials_of, painted, uv_map_of
from surveilnav.simulator.world.assembly import Mesh, MeshBuilder
from surveilnav.simulator.world.scene import Material

MAX_BYTES = 2 << 30
MAX_TRIANGLES = 50_000_000
MAX_HEADER_BYTES = 256 << 20
#: An array without data stands for zeros: nothing that a building needs.
_MAX_ZEROS = 1_000_000
_JSON, _BIN = 0x4E4F534A, 0x004E4942
#: Extensions that change where vertices lie: a file that needs another one would be read wrongly.
_KNOWN = {
    "KHR_materials_unlit",
    "KHR_texture_transform",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_lights_punctual",
    "KHR_materials_specular",
    "KHR_materials_ior",
    "KHR_materials_transmission",
    "KHR_materials_emissive_strength",
    "EXT_texture_webp",
    draco.EXTENSION,
}
_NODE: tuple[str, ...] = ("children", "matrix", "translation", "rotation", "scale", "mesh")
_PRIMITIVE: tuple[str, ...] = ("indices", "mode")
_ADVICE = {
    "KHR_texture_basisu": "its pictures are KTX2 (Basis), which isn't read: take the plain GLB (HM3D: the *-glb-v0.2 tars)",
    "EXT_meshopt_compression": f"it is compressed by meshopt: {draco.ADVICE}",
    "KHR_mesh_quantization": f"its vertices are quantised: {draco.ADVICE}",
}

_Surface = tuple[Material, "NDArray[np.float64] | None"]


@dataclass(frozen=True, slots=True, eq=False)
class NodeMesh:
    """The geometry of one node. ``way``: the numbers of its nodes from the root to itself; mesh in the file's frame."""

    way: tuple[int, ...]
    mesh: Mesh


@dataclass(frozen=True, slots=True, eq=False)
class Glb:
    """What a GLB holds: names and extras by number of the node, its meshes, and what people should know."""

    names: tuple[str, ...]
    extras: tuple[dict[str, Any], ...]
    meshes: tuple[NodeMesh, ...]
    notes: tuple[str, ...]


def read_glb(path: Path, *, max_texture_px: int | None = None) -> Glb:
    """Reads a GLB (glTF 2.0, binary).

    Args:
        max_texture_px: textures with a longer side than this are scaled down to it [pixels]; None: 2048, or 1024 if the
            file has more than 16 textures.

    Raises:
        BuildingError: the file is damaged, cut short, no GLB or too large, or it requires a glTF extension that this
            reader doesn't know; or trimesh isn't installed.
    """
    header, blob = _chunks(path)
    try:
        _refuse_unreadable(path, header)
        header, blob = draco.decompressed(path, header, blob, MAX_TRIANGLES)
        _check_arrays(path, header)
        materials, notes = materials_of(header, blob, max_texture_px)
        loaded = _load(path, header, blob, len(materials))
        names = tuple(str(node.get("name") or "") for node in header.get("nodes", []))
        extras = tuple(
            node["extras"] if isinstance(node.get("extras"), dict) else {} for node in header.get("nodes", [])
        )
        uv_maps = [*map(uv_map_of, header.get("materials", [])), None]
        meshes, skipped = _placed(path, loaded, list(zip(materials, uv_maps, strict=True)))
    except (AttributeError, IndexError, KeyError, TypeError, ValueError, OverflowError, AssertionError) as error:
        raise BuildingError(f"{path} is a damaged GLB ({type(error).__name__}: {str(error)[:120]})") from error
    if skipped:
        notes = (*notes, f"{skipped} triangles with coordinates that aren't finite were left out")
    return Glb(names, extras, meshes, notes)


def _chunks(path: Path) -> tuple[dict[str, Any], bytes]:
    """The JSON header and the binary chunk."""
    size = path.stat().st_size
    if size > MAX_BYTES:
        raise BuildingError(f"{path} is {size >> 20} MiB, more than {MAX_BYTES >> 20}: simplify it or split it")
    with path.open("rb") as file:
        head = file.read(12)
        if len(head) < 12 or head[:4] != b"glTF":
            raise BuildingError(
                f"{path} is no GLB: it begins with {head[:4]!r}, a GLB with b'glTF' (a .gltf with files: export as GLB)"
            )
        version, length = struct.unpack("<II", head[4:])
        if version != 2:
            raise BuildingError(f"{path} is glTF {version}; version 2 is read: export it anew")
        if length > size:
            raise BuildingError(f"{path} is cut short: it says {length} bytes and has {size}")
        header: dict[str, Any] | None = None
        while (lead := file.read(8)) and len(lead) == 8:
            count, kind = struct.unpack("<II", lead)
            if count > size - file.tell() or (kind == _JSON and count > MAX_HEADER_BYTES):
                raise BuildingError(f"{path} is cut short or damaged: a chunk of {count} bytes goes beyond its end")
            data = file.read(count)
            if kind == _JSON and header is None:
                header = _header(path, data)
            elif kind == _BIN and header is not None:
                return header, data
    if header is None:
        raise BuildingError(f"{path} has no JSON chunk: it is damaged")
    return header, b""


def _header(path: Path, data: bytes) -> dict[str, Any]:
    try:
        header = json.loads(data)
    except (ValueError, RecursionError) as error:
        raise BuildingError(f"{path} is a damaged GLB: its header is no JSON ({str(error)[:80]})") from error
    if not isinstance(header, dict):
        raise BuildingError(f"{path} is a damaged GLB: its header is a {type(header).__name__}, not an object")
    return header


def _refuse_unreadable(path: Path, header: dict[str, Any]) -> None:
    for name in header.get("extensionsRequired", []):
        if name not in _KNOWN:
            advice = _ADVICE.get(name, "which isn't read: export it without")
            raise BuildingError(f"{path} needs the extension {name}; {advice}")
    for buffer in header.get("buffers", []):
        if "uri" in buffer:
            raise BuildingError(f"{path} has its geometry in other files: export it as one GLB")


def _check_arrays(path: Path, header: dict[str, Any]) -> None:
    """Arrays that aren't read, or larger than any building's."""
    if any("sparse" in accessor for accessor in header.get("accessors", [])):
        raise BuildingError(f"{path} uses sparse accessors, which aren't read: export it without")
    for accessor in header.get("accessors", []):
        most = 3 * MAX_TRIANGLES if "bufferView" in accessor else _MAX_ZEROS
        if not 0 <= int(accessor["count"]) <= most:
            raise BuildingError(f"{path} has {accessor['count']} entries in one array; at most {most} are read")


def _load(path: Path, header: dict[str, Any], blob: bytes, materials: int) -> dict[str, Any]:
    """trimesh's reading of the numbered header: "geometry" by name and "graph", a list of edges."""
    try:
        from trimesh.exchange.gltf import load_gltf
    except ImportError as error:
        raise BuildingError(f"{path}: reading GLB files needs trimesh: pip install 'surveilnav[mesh]'") from error

    def plain(node: dict[str, Any], number: int) -> dict[str, Any]:
        return {**{key: node[key] for key in _NODE if key in node}, "name": str(number)}

    def primitive(p: dict[str, Any]) -> dict[str, Any]:
        attributes = {k: v for k, v in p["attributes"].items() if k in draco.ATTRIBUTES}
        return {
            **{key: p[key] for key in _PRIMITIVE if key in p},
            "attributes": attributes,
            "material": p.get("material", materials - 1),
        }

    numbered = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": _roots(header)}],
        "scene": 0,
        "nodes": [plain(node, i) for i, node in enumerate(header.get("nodes", []))],
        "meshes": [
            {"name": str(i), "primitives": [primitive(p) for p in mesh["primitives"]]}
            for i, mesh in enumerate(header.get("meshes", []))
        ],
        "materials": [{"name": str(i)} for i in range(materials)],
        "accessors": header.get("accessors", []),
        "bufferViews": header.get("bufferViews", []),
        "buffers": [{"uri": "blob", "byteLength": len(blob)}],
    }
    text = io.BytesIO(json.dumps(numbered).encode())
    loaded: dict[str, Any] = load_gltf(file_obj=text, resolver={"blob": blob}, process=False)  # type: ignore[arg-type]
    return loaded


def _roots(header: dict[str, Any]) -> list[int]:
    """The nodes of the scene that is shown; all that nobody holds, where the file has no scenes."""
    scenes = header.get("scenes")
    if scenes:
        return list(scenes[header.get("scene", 0)].get("nodes", []))
    held = Counter(child for node in header.get("nodes", []) for child in node.get("children", []))
    return [i for i in range(len(header.get("nodes", []))) if not held[i]]


def _placed(path: Path, loaded: dict[str, Any], materials: list[_Surface]) -> tuple[tuple[NodeMesh, ...], int]:
    """All meshes where their nodes put them, and how many triangles had to be left out."""
    T_root_node: dict[str, NDArray[np.float64]] = {"world": np.eye(4)}
    way: dict[str, tuple[int, ...]] = {"world": ()}
    found: list[NodeMesh] = []
    total = skipped = 0
    for edge in loaded["graph"]:
        above, name = edge["frame_from"], edge["frame_to"]
        T = T_root_node[above] @ np.asarray(edge["matrix"], dtype=np.float64)
        number = int(name.split("_")[0])  # further primitives of a node are called "12_K3F9"
        here = way[above] if way[above][-1:] == (number,) else (*way[above], number)
        T_root_node[name], way[name] = T, here
        if "geometry" not in edge:
            continue
        part = loaded["geometry"][edge["geometry"]]
        if "faces" not in part:
            continue
        total += len(part["faces"])
        if total > MAX_TRIANGLES:
            raise BuildingError(f"{path} has more than {MAX_TRIANGLES} triangles: simplify it")
        mesh, bad = _mesh(part, T, materials)
        skipped += bad
        if len(mesh.triangles):
            found.append(NodeMesh(here, mesh))
    return tuple(sorted(found, key=lambda node: node.way[-1])), skipped


def _mesh(part: dict[str, Any], T: NDArray[np.float64], materials: list[_Surface]) -> tuple[Mesh, int]:
    with np.errstate(all="ignore"):
        vertices = np.asarray(part["vertices"], dtype=np.float64).reshape(-1, 3)
    faces = np.asarray(part["faces"], dtype=np.int64).reshape(-1, 3)
    if len(faces) and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise ValueError(f"a triangle names vertex {faces.max()} of {len(vertices)}")
    with np.errstate(all="ignore"):
        moved = vertices @ T[:3, :3].T + T[:3, 3]
    inside = np.asarray((np.abs(moved) < 1e6).all(axis=1))  # false for NaN as well
    good = inside[faces].all(axis=1)
    bad = int((~good).sum())
    if not good.any():
        return MeshBuilder().mesh(), bad
    if math.copysign(1.0, float(np.linalg.det(T[:3, :3]))) < 0:
        faces = faces[:, ::-1]
    faces = faces[good]
    visual = part["visual"]
    material, uv_map = materials[int(visual.material.name)]
    uv = np.zeros((len(vertices), 2)) if visual.uv is None else np.asarray(visual.uv, dtype=np.float64)
    if uv_map is not None:
        uv = uv @ uv_map[:, :2].T + uv_map[:, 2]
    colors = visual.vertex_attributes.get("color")
    used, renumbered = np.unique(faces, return_inverse=True)
    mesh = Mesh(
        moved[used].astype(np.float32),
        renumbered.reshape(-1, 3).astype(np.int32),
        np.nan_to_num(uv[faces], nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32),
        np.zeros(len(faces), np.int32),
        (material,),
    )
    return painted(mesh, None if colors is None else np.asarray(colors)[faces]), bad
