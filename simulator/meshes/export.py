"""Any of our buildings as files: a GLB with names and classes, or HM3D's folder."""

from __future__ import annotations

import colorsys
import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes.names import label_of_hm3d
from surveilnav.simulator.render.tones import to_linear
from surveilnav.simulator.world.scene import Instance, Material, Scene
from surveilnav.storage import atomic_write

HEADER = "HM3D Semantic Annotations"
#: A primitive: triangles' corners (F, 3, 3) in the file's frame, their uv (F, 3, 2), the material's number.
_Primitive = tuple[NDArray[np.float32], NDArray[np.float32], int]
_BLOCK_PX = 4


def export_glb(scene: Scene, path: Path) -> None:
    """Writes a GLB (y up): a node per instance, its class, model and room in the node's extras.

    Raises:
        BuildingError: it can't be written.
    """
    _write(path, _nodes(scene, y_up=True), scene.materials)


def export_hm3d(scene: Scene, folder: Path) -> None:
    """Writes ``NAME.glb``, ``NAME.semantic.glb`` and ``NAME.semantic.txt`` (z up); NAME is the folder's part after "-".

    Raises:
        BuildingError: it can't be written.
    """
    stem = folder.name.partition("-")[2] or folder.name
    colors = _colors(len(scene.instances))
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _write(folder / f"{stem}.glb", _nodes(scene, y_up=False), scene.materials)
        _write(folder / f"{stem}.semantic.glb", *_semantic(scene, colors))
        with (folder / f"{stem}.semantic.txt").open("w", newline="") as file:
            file.write(HEADER + "\n")
            rooms = {room: i for i, room in enumerate(dict.fromkeys(i.room for i in scene.instances), start=1)}
            for instance, (r, g, b) in zip(scene.instances, colors.tolist(), strict=True):
                name = _raw_name(instance).replace('"', "'")
                file.write(f'{instance.id},{r:02X}{g:02X}{b:02X},"{name}",{rooms[instance.room]}\n')
    except OSError as error:
        raise BuildingError(f"{folder} can't be written: {error}") from error


def _raw_name(instance: Instance) -> str:
    """A name that HM3D's reader gives the same class."""
    if instance.label:
        return instance.label
    name = " ".join(instance.name.lower().split())
    return f"other {name}" if label_of_hm3d(name) else name


def _colors(count: int) -> NDArray[np.uint8]:
    """(count, 3) colours that differ, neighbours strongly."""
    step = 0.618033988749895
    picked: dict[tuple[int, int, int], None] = {}
    number = 0
    while len(picked) < count:
        r, g, b = colorsys.hsv_to_rgb(
            number * step % 1.0, 0.45 + 0.5 * (number * 0.37 % 1.0), 0.5 + 0.5 * (number * 0.73 % 1.0)
        )
        picked.setdefault((round(r * 255), round(g * 255), round(b * 255)))
        number += 1
    return np.array(list(picked), np.uint8).reshape(-1, 3)


def _frame(corners: NDArray[np.float32], y_up: bool) -> NDArray[np.float32]:
    if not y_up:
        return corners
    return np.stack([corners[..., 0], corners[..., 2], -corners[..., 1]], axis=-1)


def _nodes(scene: Scene, *, y_up: bool) -> Iterator[tuple[str, dict[str, str], list[_Primitive]]]:
    """Name, extras and primitives of every instance."""
    order = np.lexsort((scene.material_of_triangle, scene.instance_of_triangle))
    owner, material = scene.instance_of_triangle[order], scene.material_of_triangle[order]
    corners = _frame(scene.vertices[scene.triangles[order]], y_up)
    uvs = scene.uvs[order]
    named = {i.id: i for i in scene.instances}
    for number in np.unique(owner):
        first, end = np.searchsorted(owner, [number, number + 1])
        cuts = first + np.flatnonzero(np.diff(material[first:end], prepend=-1))
        ends = [*cuts[1:], end]
        primitives = [(corners[a:b], uvs[a:b], int(material[a])) for a, b in zip(cuts, ends, strict=True)]
        instance = named.get(int(number))
        if instance is None:
            yield "nameless", {"label": ""}, primitives
        else:
            extras = {"label": instance.label, "floor": instance.floor, "model": instance.model, "room": instance.room}
            yield instance.name, extras, primitives


def _semantic(
    scene: Scene, colors: NDArray[np.uint8]
) -> tuple[Iterator[tuple[str, dict[str, str], list[_Primitive]]], tuple[Material, ...]]:
    """One mesh with one picture that has a block of texels per instance; what has no instance is black."""
    size = int(np.ceil(np.sqrt(len(scene.instances) + 1)))
    texels = np.zeros((size * size, 3), np.uint8)
    block = np.zeros(65_536, np.int64)
    for index, instance in enumerate(scene.instances, start=1):
        texels[index], block[instance.id] = colors[index - 1], index
    picture = np.kron(texels.reshape(size, size, 3), np.ones((_BLOCK_PX, _BLOCK_PX, 1), np.uint8)).astype(np.uint8)
    row, col = np.divmod(block[scene.instance_of_triangle], size)
    middle = np.stack([(col + 0.5) / size, 1.0 - (row + 0.5) / size], axis=1).astype(np.float32)
    uvs = np.repeat(middle[:, None], 3, axis=1)
    primitive = (scene.vertices[scene.triangles], uvs, 0)
    return iter([("semantic", {}, [primitive])]), (Material("semantic", (1.0, 1.0, 1.0), picture),)


def _write(
    path: Path, nodes: Iterator[tuple[str, dict[str, str], list[_Primitive]]], materials: tuple[Material, ...]
) -> None:
    """The GLB itself (glTF 2.0, section 4.4): header, JSON chunk, binary chunk."""
    tree = _Tree()
    stored = [_stored(m, tree) for m in materials]
    for name, extras, primitives in nodes:
        tree.add_node(name, extras, primitives)
    text = json.dumps(tree.header(stored), separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + tree.written
    if total >= 2**32:
        raise BuildingError(f"{path} would have {total >> 20} MiB: a GLB has at most 4096")
    try:
        with atomic_write(path) as file:
            file.write(struct.pack("<4sII", b"glTF", 2, total))
            file.write(struct.pack("<I4s", len(text), b"JSON") + text)
            file.write(struct.pack("<I4s", tree.written, b"BIN\0"))
            file.writelines(tree.parts)
    except OSError as error:
        raise BuildingError(f"{path} can't be written: {error}") from error


class _Tree:
    """The lists of a glTF file by name, and the ``parts`` of its binary chunk, ``written`` bytes in all."""

    def __init__(self) -> None:
        names = ("accessors", "bufferViews", "meshes", "nodes", "images", "textures")
        self._lists: dict[str, list[dict[str, Any]]] = {name: [] for name in names}
        self.parts: list[bytes] = []
        self.written = 0

    def _add(self, name: str, entry: dict[str, Any]) -> int:
        self._lists[name].append(entry)
        return len(self._lists[name]) - 1

    def _add_bytes(self, data: bytes) -> int:
        padded = data + b"\0" * (-len(data) % 4)
        view = self._add("bufferViews", {"buffer": 0, "byteOffset": self.written, "byteLength": len(data)})
        self.parts.append(padded)
        self.written += len(padded)
        return view

    def _add_array(self, array: NDArray[np.floating], kind: str) -> int:
        array = np.ascontiguousarray(array, np.float32)
        view = self._add_bytes(array.tobytes())
        entry = {"bufferView": view, "componentType": 5126, "count": len(array), "type": kind}
        if kind == "VEC3":
            entry |= {"min": array.min(axis=0).tolist(), "max": array.max(axis=0).tolist()}
        return self._add("accessors", entry)

    def add_node(self, name: str, extras: dict[str, str], primitives: list[_Primitive]) -> None:
        """Adds a node with a mesh of its own."""
        listed = []
        for corners, uv, material in primitives:
            flipped = np.stack([uv[..., 0], 1.0 - uv[..., 1]], axis=-1).reshape(-1, 2)
            attributes = {
                "POSITION": self._add_array(corners.reshape(-1, 3), "VEC3"),
                "TEXCOORD_0": self._add_array(flipped, "VEC2"),
            }
            listed.append({"attributes": attributes, "material": material})
        self._add("nodes", {"name": name, "mesh": self._add("meshes", {"primitives": listed}), "extras": extras})

    def add_texture(self, png: bytes) -> int:
        """Adds a picture; returns the number of its texture."""
        image = self._add("images", {"bufferView": self._add_bytes(png), "mimeType": "image/png"})
        return self._add("textures", {"source": image})

    def header(self, materials: list[dict[str, Any]]) -> dict[str, Any]:
        """The JSON chunk."""
        return {
            "asset": {"version": "2.0", "generator": "SurveilNav"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self._lists["nodes"])))}],
            "materials": materials,
            "buffers": [{"byteLength": self.written}],
            **{name: entries for name, entries in self._lists.items() if entries},
        }


def _stored(material: Material, tree: _Tree) -> dict[str, Any]:
    """A material's entry; its picture goes into the tree as PNG."""
    linear = to_linear(np.array(material.color, dtype=np.float64)).tolist()
    base: dict[str, Any] = {
        "baseColorFactor": [*linear, material.alpha],
        "metallicFactor": 0.0,
        "roughnessFactor": 1.0 - material.shininess,
    }
    if material.texture is not None:
        ok, png = cv2.imencode(".png", np.ascontiguousarray(material.texture[..., ::-1]))
        if not ok:
            raise BuildingError(f"the picture of {material.name!r} can't be written as PNG")
        base["baseColorTexture"] = {"index": tree.add_texture(png.tobytes())}
    mode = {"alphaMode": "BLEND"} if material.alpha < 1.0 else {}
    return {"name": material.name, "pbrMetallicRoughness": base, "doubleSided": True, **mode}
