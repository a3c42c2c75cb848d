"""Meshes that Draco compressed in a GLB (KHR_draco_mesh_compression), as plain arrays.

DracoPy decodes them. What a stream says of its size is checked first: a few bytes can ask for gigabytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import BuildingError

EXTENSION = "KHR_draco_mesh_compression"
#: gltf-transform reads Draco, meshopt and quantised vertices, and writes none of them.
ADVICE = "convert it: npx @gltf-transform/cli dequantize IN.glb OUT.glb"
#: A byte makes half a triangle to two; a bomb makes thousands. Small meshes may do what they like.
MAX_TRIANGLES_PER_BYTE = 100
FREE_TRIANGLES = 100_000
#: Streams begin with this: version 2.2 (the one that glTF names), a triangle mesh.
_MAGIC = b"DRACO\x02\x02\x01"
_SEQUENTIAL, _EDGEBREAKER = 0, 1
_DTYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_UNSIGNED_INT, _TRIANGLES = 5125, 4
#: What is read of a primitive.
ATTRIBUTES: tuple[str, ...] = ("POSITION", "TEXCOORD_0", "COLOR_0")


def decompressed(path: Path, header: dict[str, Any], blob: bytes, max_triangles: int) -> tuple[dict[str, Any], bytes]:
    """A GLB's header and binary chunk with plain arrays in the place of Draco's; the header is changed.

    Raises:
        BuildingError: a stream is damaged or too large, or DracoPy isn't installed.
    """
    packed = list(_packed(header))
    if not packed:
        return header, blob
    decode = _decoder(path)
    plain = _Appended(header, blob)
    done: dict[tuple[Any, ...], dict[str, Any]] = {}
    left = max_triangles
    for primitive, extension in packed:
        ids = {name: int(number) for name, number in extension["attributes"].items() if name in ATTRIBUTES}
        key = (int(extension["bufferView"]), *sorted(ids.items()))
        if key not in done:
            data = _bytes_of(path, header["bufferViews"][key[0]], blob)
            left -= _promised_triangles(path, data)
            if left < 0:
                raise BuildingError(f"{path} has more than {max_triangles} triangles: simplify it")
            done[key] = plain.arrays(path, primitive, ids, decode(data))
        plain.replace(primitive, done[key])
    return header, plain.blob()


def _packed(header: dict[str, Any]) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Primitives whose arrays are nowhere but in Draco's stream, each with its extension."""
    accessors = header.get("accessors", [])
    for mesh in header.get("meshes", []):
        for primitive in mesh["primitives"]:
            extension = primitive.get("extensions", {}).get(EXTENSION)
            if extension is not None and "bufferView" not in accessors[primitive["attributes"]["POSITION"]]:
                yield primitive, extension


def _decoder(path: Path) -> Callable[[bytes], Any]:
    try:
        import DracoPy
    except ImportError as error:
        raise BuildingError(
            f"{path} is compressed by Draco, and DracoPy isn't installed: pip install 'surveilnav[mesh]', or {ADVICE}"
        ) from error

    def decode(data: bytes) -> Any:
        try:
            return DracoPy.decode(data)
        except (DracoPy.FileTypeException, ValueError, MemoryError) as error:
            raise BuildingError(f"{path} has a damaged Draco stream ({error}): export it anew, or {ADVICE}") from error

    return decode


def _bytes_of(path: Path, view: dict[str, Any], blob: bytes) -> bytes:
    start, count = int(view.get("byteOffset", 0)), int(view["byteLength"])
    if int(view.get("buffer", 0)) != 0 or not 0 <= start <= start + count <= len(blob):
        raise BuildingError(f"{path} has a Draco stream beyond its binary chunk: it is cut short or damaged")
    return blob[start : start + count]


def _promised_triangles(path: Path, data: bytes) -> int:
    """How many triangles a stream says that it holds (Draco's bitstream specification, 2.2).

    Raises:
        BuildingError: another version, metadata before the mesh, or more than its bytes can stand for.
    """
    # Magic, method, flags (two bytes; metadata would come before the mesh), then numbers of seven bits a byte.
    if data[: len(_MAGIC)] != _MAGIC or len(data) < 12 or data[8] not in (_SEQUENTIAL, _EDGEBREAKER) or data[10] & 0x80:
        raise BuildingError(f"{path} has a Draco stream that isn't a plain mesh of version 2.2: {ADVICE}")
    first, at = _varint(data, 11 if data[8] == _SEQUENTIAL else 12)
    second, _ = _varint(data, at)
    triangles, vertices = (first, second) if data[8] == _SEQUENTIAL else (second, first)
    if max(triangles, vertices) > max(FREE_TRIANGLES, MAX_TRIANGLES_PER_BYTE * len(data)):
        raise BuildingError(
            f"{path} has a Draco stream of {len(data)} bytes that asks for {triangles} triangles: refused as a bomb"
        )
    return triangles


def _varint(data: bytes, at: int) -> tuple[int, int]:
    """A number and where it ends; larger than any mesh where it doesn't."""
    value = shift = 0
    for end in range(at, min(at + 6, len(data))):
        value |= (data[end] & 0x7F) << shift
        shift += 7
        if data[end] < 0x80:
            return value, end + 1
    return 1 << 60, at


class _Appended:
    """Arrays behind a binary chunk, and the accessors that lead to them."""

    def __init__(self, header: dict[str, Any], blob: bytes) -> None:
        self._accessors: list[dict[str, Any]] = header["accessors"]
        self._views: list[dict[str, Any]] = header["bufferViews"]
        self._parts: list[bytes] = [blob + b"\0" * (-len(blob) % 4)]
        self._end = len(self._parts[0])

    def blob(self) -> bytes:
        """The chunk with all arrays."""
        return b"".join(self._parts)

    def arrays(self, path: Path, primitive: dict[str, Any], ids: dict[str, int], mesh: Any) -> dict[str, Any]:
        """What a primitive gets of a decoded mesh: "attributes", "indices", "mode"."""
        found = {attribute["unique_id"]: attribute["data"] for attribute in mesh.attributes}
        attributes: dict[str, int] = {}
        for name, number in ids.items():
            like = self._accessors[primitive["attributes"][name]]
            values = np.asarray(found.get(number, ()))
            if values.ndim != 2 or values.shape[1] != _WIDTHS[like["type"]]:
                raise BuildingError(f"{path} has a Draco stream without its attribute {name}: it is damaged")
            attributes[name] = self._add(like, values)
        if "POSITION" not in attributes:
            raise BuildingError(f"{path} has a Draco stream without positions: it is damaged")
        indices = self._add({"componentType": _UNSIGNED_INT, "type": "SCALAR"}, np.asarray(mesh.faces).reshape(-1, 1))
        return {"attributes": attributes, "indices": indices, "mode": _TRIANGLES}

    def replace(self, primitive: dict[str, Any], arrays: dict[str, Any]) -> None:
        """Gives a primitive its arrays. Of those that it had, the empty ones are gone: zeros would be read for them."""
        attributes: dict[str, int] = dict(arrays["attributes"])
        for name, old in primitive["attributes"].items():
            if "bufferView" not in self._accessors[old]:
                self._accessors[old] = self._accessors[attributes[name if name in attributes else "POSITION"]]
            else:
                attributes.setdefault(name, old)
        self._accessors[primitive["indices"]] = self._accessors[arrays["indices"]]
        primitive.update(arrays, attributes=attributes)

    def _add(self, like: dict[str, Any], values: NDArray) -> int:
        """The number of a new accessor, like another one, that leads to these values (N, k)."""
        with np.errstate(invalid="ignore"):
            data = np.ascontiguousarray(values, dtype=_DTYPES[like["componentType"]]).tobytes()
        kept: dict[str, Any] = {key: like[key] for key in ("componentType", "type", "normalized") if key in like}
        self._accessors.append({**kept, "bufferView": len(self._views), "count": len(values)})
        self._views.append({"buffer": 0, "byteOffset": self._end, "byteLength": len(data)})
        self._parts.append(data + b"\0" * (-len(data) % 4))
        self._end += len(self._parts[-1])
        return len(self._accessors) - 1
