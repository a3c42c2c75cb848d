"""Turns a mesh into a building: finds its floors and stairs, and gives each named thing an instance."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes.flights import find_stairs
from surveilnav.simulator.meshes.floors import find_floors, outlines
from surveilnav.simulator.meshes.gltf import MAX_TRIANGLES, Glb, read_glb
from surveilnav.simulator.meshes.names import label_of_extra, label_of_node
from surveilnav.simulator.meshes.things import ANY_SIZE_M, MeshPart, box_of, whole_things
from surveilnav.simulator.meshes.walkable import find_spots
from surveilnav.simulator.meshes.wavefront import read_obj_building
from surveilnav.simulator.world.assembly import Mesh, SceneBuilder
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Floor, Room, Scene, Stair, point3

#: glTF's frame (y up) in ours (z up).
T_WORLD_YUP = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
_SMALLEST_M, _LARGEST_M, _HIGHEST_M = 1.5, 1000.0, 300.0


def open_mesh(path: Path, *, up: str = "y", scale: float = 1.0) -> Scene:
    """A GLB or OBJ as a building: one instance per named thing, floors and stairs found from the geometry.

    Args:
        up: the axis that points up in the file, "y" (glTF's rule) or "z".
        scale: metres per unit of the file.

    Raises:
        BuildingError: it can't be read, has nowhere to stand, or isn't of a building's size.
    """
    if not path.is_file():
        raise BuildingError(f"there is no file {path}; expected a .glb or .obj file, or a folder of HM3D")
    if not 0.0 < scale < np.inf:
        raise BuildingError(f"the scale is a positive number of metres per unit, got {scale}")
    T = np.diag([scale, scale, scale, 1.0])
    if up == "y":
        T = T_WORLD_YUP @ T
    elif up != "z":
        raise BuildingError(f"up is 'y' or 'z', got {up!r}")
    notes: tuple[str, ...] = ()
    if path.suffix.lower() == ".obj":
        pieces = [MeshPart(name, None, (mesh.moved(T),)) for name, mesh in read_obj_building(path)]
    else:
        glb = read_glb(path)
        pieces, notes = _pieces(glb, T), glb.notes
    return building_of(whole_things(pieces), scene_name(path.stem), f"mesh {path.name}", notes)


def scene_name(stem: str) -> str:
    """A file's name as a building's."""
    return re.sub(r"[^A-Za-z0-9_.]+", "_", stem)[:40].strip("_.") or "building"


def _pieces(glb: Glb, T_world_file: NDArray[np.float64]) -> list[MeshPart]:
    """One piece for each node with a mesh. A node without a class of its own joins the nearest ancestor that has one."""
    stated = {n: _stated_label(glb.extras[n]) for mesh in glb.meshes for n in mesh.way}
    classed = {n for n in stated if stated[n] or (stated[n] is None and label_of_node(glb.names[n], ANY_SIZE_M))}
    grouped: dict[int, list[Mesh]] = {}
    for node in glb.meshes:
        own = node.way[-1]
        if stated[own] is None:  # what a node states holds, be it "no class"
            own = next((n for n in reversed(node.way) if n in classed), own)
        grouped.setdefault(own, []).append(node.mesh.moved(T_world_file))
    pieces = []
    for number, meshes in grouped.items():
        extras = glb.extras[number]
        room, model = (str(extras[k])[:80] if isinstance(extras.get(k), str) else "" for k in ("room", "model"))
        name = glb.names[number][:80] or f"node {number}"
        pieces.append(MeshPart(name, stated[number], tuple(meshes), room, model))
    return pieces


def _stated_label(extras: dict[str, Any]) -> str | None:
    """The class that a node's extras state; None if they state none."""
    found = (label_of_extra(extras.get(key)) for key in ("label", "category", "class"))
    return next((label for label in found if label is not None), None)


def building_of(pieces: Sequence[MeshPart], name: str, source: str, notes: Sequence[str] = ()) -> Scene:
    """The scene of some pieces in the world (z up, metres).

    Raises:
        BuildingError: nothing there, not of a building's size, or nowhere to stand.
    """
    pieces = [replace(p, meshes=tuple(m for m in p.meshes if len(m.triangles))) for p in pieces]
    pieces = [p for p in pieces if p.meshes]
    if not pieces:
        raise BuildingError(f"{name} has no triangles: expected the mesh of a building")
    _check_size(pieces, name)
    bare = _assembled(pieces, name, source, (), [], (), [])
    caster = RayCaster(bare)
    spots = find_spots(bare, caster)
    grounds, about_floors = find_floors(spots)
    if not grounds:
        raise BuildingError(
            f"{name} has no floor: expected level ground of at least 4 m2 with 1.5 m of free height. Is its up axis right "
            "(GLB and OBJ: y up; HM3D: z up) and its unit metres?"
        )
    stairs = find_stairs(bare, spots, grounds)
    floors = tuple(s.floor for s in grounds)
    rooms = [room for s in grounds for room in outlines(spots, s)]
    found = [*notes, *about_floors, *_about(floors, stairs)]
    return _assembled(pieces, name, source, floors, rooms, stairs, found)


def _check_size(pieces: Sequence[MeshPart], name: str) -> None:
    low, high = box_of([mesh for piece in pieces for mesh in piece.meshes])
    width, depth, height = point3(high - low)
    if max(width, depth) > _LARGEST_M or height > _HIGHEST_M or max(width, depth) < _SMALLEST_M:
        raise BuildingError(
            f"{name} is {width:.4g} x {depth:.4g} x {height:.4g} m: not a building's size. Is its unit metres? "
            "Convert it: python -m surveilnav.simulator.meshes FILE OUT.glb --scale 0.001 (millimetres)"
        )


def _about(floors: Sequence[Floor], stairs: Sequence[Stair]) -> list[str]:
    """Notes for people on floors that no stair leads to."""
    joined = {f for s in stairs for f in (s.lower_floor, s.upper_floor)}
    lonely = [f"{f.id} ({f.z_m:.2f} m)" for f in floors if f.id not in joined]
    return [f"no stairs found to floor {', '.join(lonely)}"] if len(floors) > 1 and lonely else []


def _assembled(
    pieces: Sequence[MeshPart],
    name: str,
    source: str,
    floors: tuple[Floor, ...],
    rooms: list[Room],
    stairs: tuple[Stair, ...],
    notes: list[str],
) -> Scene:
    builder = SceneBuilder(name, list(rooms), list(floors), list(stairs), list(notes), max_triangles=MAX_TRIANGLES)
    for piece in pieces:
        mesh = _joined(piece.meshes)
        low, high = box_of([mesh])
        label = piece.label if piece.label is not None else label_of_node(piece.name, point3(high - low))
        floor = _floor_of(floors, float(low[2]), float(high[2]))
        builder.add(mesh, piece.name, label, floor, model=piece.model, room=piece.room)
    return builder.build(source)


def _floor_of(floors: Sequence[Floor], z_low_m: float, z_high_m: float) -> str:
    """The floor that a thing stands or hangs on: the highest below its middle."""
    below = [f for f in floors if f.z_m <= (z_low_m + z_high_m) / 2 + 0.1]
    return (below[-1] if below else floors[0]).id if floors else ""


def _joined(meshes: Sequence[Mesh]) -> Mesh:
    if len(meshes) == 1:
        return meshes[0]
    materials = tuple({id(m): m for mesh in meshes for m in mesh.materials}.values())
    index = {id(m): i for i, m in enumerate(materials)}
    offsets = np.cumsum([0, *(len(m.vertices) for m in meshes)])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]),
        np.concatenate([m.triangles + np.int32(o) for m, o in zip(meshes, offsets[:-1], strict=True)]),
        np.concatenate([m.uvs for m in meshes]),
        np.concatenate([np.array([index[id(k)] for k in m.materials], np.int32)[m.material] for m in meshes]),
        materials,
    )
