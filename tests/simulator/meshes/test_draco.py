"""GLBs that Draco compressed, made here by DracoPy; and streams that are damaged or ask for too much."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes import draco, gltf
from surveilnav.simulator.meshes.gltf import read_glb
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.scene import Scene
from tests.simulator.meshes.conftest import glb_bytes, hall_corners

pytest.importorskip("trimesh")
DracoPy = pytest.importorskip("DracoPy", reason="DracoPy isn't installed: pip install 'surveilnav[mesh]'")

Change = Callable[[dict[str, Any]], object]


def stream(sequential: bool = False, bits: int = 16) -> bytes:
    corners = hall_corners().reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.uint32).reshape(-1, 3)
    uv = np.ascontiguousarray(corners[:, :2] / 6.0, dtype=np.float64)
    data: bytes = DracoPy.encode(corners, faces, quantization_bits=bits, tex_coord=uv, preserve_order=sequential)
    return data


@pytest.fixture
def packed(tmp_path: Path) -> Callable[..., Path]:
    """``packed(stream, change)`` writes the hall as a Draco stream after ``change(header)``."""

    def write(data: bytes, change: Change = lambda header: None) -> Path:
        mesh = DracoPy.decode(stream())
        ids = {a["attribute_type"]: a["unique_id"] for a in mesh.attributes}
        extension = {"bufferView": 0, "attributes": {"POSITION": ids[0], "TEXCOORD_0": ids[3]}}
        header: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "extensionsRequired": [draco.EXTENSION],
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0, "name": "hall"}],
            "meshes": [
                {
                    "primitives": [
                        {
                            "attributes": {"POSITION": 0, "TEXCOORD_0": 1, "NORMAL": 2},
                            "indices": 3,
                            "extensions": {draco.EXTENSION: extension},
                        }
                    ]
                }
            ],
            "accessors": [
                {"componentType": 5126, "count": 36, "type": "VEC3"},
                {"componentType": 5126, "count": 36, "type": "VEC2"},
                {"componentType": 5126, "count": 2_000_000, "type": "VEC3"},
                {"componentType": 5123, "count": 36, "type": "SCALAR"},
            ],
            "bufferViews": [{"buffer": 0, "byteLength": len(data)}],
            "buffers": [{"byteLength": len(data)}],
        }
        change(header)
        path = tmp_path / "hall.glb"
        path.write_bytes(glb_bytes(header, data))
        return path

    return write


def middles(scene: Scene) -> list[list[float]]:
    found: list[list[float]] = np.round(scene.vertices[scene.triangles].mean(axis=1), 2).tolist()
    return sorted(found)


@pytest.mark.parametrize("sequential", [False, True])
def test_a_packed_hall_is_the_hall(packed: Callable[..., Path], hall: Callable[..., Path], sequential: bool) -> None:
    scene, plain = open_building(str(packed(stream(sequential)))), open_building(str(hall()))
    assert len(scene.triangles) == len(plain.triangles) == 12
    # Draco orders triangles and corners anew, and joins corners that are the same.
    np.testing.assert_allclose(middles(scene), middles(plain), atol=1e-3)
    assert scene.floors[0].height_m == pytest.approx(3.0, abs=1e-3)
    # Texture coordinates stay with their corners: u was x / 6, v was glTF's y / 6, and trimesh turns v over.
    corners = scene.vertices[scene.triangles]
    np.testing.assert_allclose(scene.uvs[..., 0], corners[..., 0] / 6, atol=2e-3)
    np.testing.assert_allclose(scene.uvs[..., 1], 1 - corners[..., 2] / 6, atol=2e-3)


def test_plain_arrays_beside_a_stream_are_taken(hall: Callable[..., Path]) -> None:
    def both(header: dict[str, Any]) -> None:
        header["meshes"][0]["primitives"][0]["extensions"] = {draco.EXTENSION: {"bufferView": 99, "attributes": {}}}

    assert len(open_building(str(hall(both))).triangles) == 12


def test_one_stream_for_many_nodes_is_decoded_once(
    packed: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []
    decode = DracoPy.decode
    path = packed(stream(), lambda h: h["meshes"].extend(h["meshes"] * 9))
    monkeypatch.setattr(DracoPy, "decode", lambda data: calls.append(1) or decode(data))
    assert len(read_glb(path).meshes) == 1
    assert calls == [1]


def sizes(method: int, *numbers: int) -> bytes:
    def varint(value: int) -> bytes:
        return bytes([value & 0x7F | 0x80]) + varint(value >> 7) if value > 0x7F else bytes([value])

    return b"DRACO\x02\x02\x01" + bytes([method, 0, 0]) + bytes(method) + b"".join(map(varint, numbers)) + bytes(50)


def _first(header: dict[str, Any]) -> dict[str, Any]:
    primitive: dict[str, Any] = header["meshes"][0]["primitives"][0]
    return primitive


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "isn't a plain mesh"),
        (b"DRACO", "isn't a plain mesh"),
        (b"glTF" * 9, "isn't a plain mesh"),
        (b"DRACO\x01\x05\x01" + bytes(50), "version 2.2"),
        (b"DRACO\x02\x02\x00" + bytes(50), "isn't a plain mesh"),
        (b"DRACO\x02\x02\x01\x00\x00\x80" + bytes(50), "isn't a plain mesh"),
        (sizes(0, 4_000_000_000, 3), "4000000000 triangles: refused as a bomb"),
        (sizes(1, 3, 4_000_000_000), "bomb"),
        (sizes(0, 3, 4_000_000_000), "bomb"),
        (b"DRACO\x02\x02\x01\x00\x00\x00" + b"\xff" * 50, "bomb"),
        (sizes(0, 12, 36), "damaged Draco stream"),
        (sizes(1, 36, 12), "damaged Draco stream"),
    ],
)
def test_what_is_no_stream_is_refused(packed: Callable[..., Path], data: bytes, says: str) -> None:
    with pytest.raises(BuildingError, match=says):
        read_glb(packed(data))


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda h: h["bufferViews"][0].update(byteLength=10**9), "beyond its binary chunk"),
        (lambda h: h["bufferViews"][0].update(byteOffset=-5), "beyond its binary chunk"),
        (lambda h: h["bufferViews"][0].update(buffer=1), "beyond its binary chunk"),
        (lambda h: _first(h)["extensions"][draco.EXTENSION]["attributes"].update(POSITION=77), "attribute POSITION"),
        (lambda h: _first(h)["extensions"][draco.EXTENSION]["attributes"].pop("POSITION"), "without positions"),
        (lambda h: h["accessors"][1].update(type="VEC3"), "attribute TEXCOORD_0"),
        (lambda h: h["accessors"][0].update(componentType=1), "damaged GLB"),
        (lambda h: _first(h)["extensions"].update({draco.EXTENSION: []}), "damaged GLB"),
        (lambda h: _first(h).pop("indices"), "damaged GLB"),
    ],
)
def test_headers_that_lie_are_refused(packed: Callable[..., Path], change: Change, says: str) -> None:
    with pytest.raises(BuildingError, match=says):
        read_glb(packed(stream(), change))


def test_triangles_of_all_streams_are_counted(packed: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    def twice(header: dict[str, Any]) -> None:
        header["bufferViews"].append(dict(header["bufferViews"][0]))
        extension = {**_first(header)["extensions"][draco.EXTENSION], "bufferView": 1}
        header["meshes"][0]["primitives"].append({**_first(header), "extensions": {draco.EXTENSION: extension}})

    path = packed(stream(), twice)
    calls = []
    decode = DracoPy.decode
    monkeypatch.setattr(DracoPy, "decode", lambda data: calls.append(1) or decode(data))
    monkeypatch.setattr(gltf, "MAX_TRIANGLES", 20)
    with pytest.raises(BuildingError, match="more than 20 triangles"):
        read_glb(path)
    assert calls == [1]  # refused before the second is unpacked


def test_damage_anywhere_in_a_stream_is_met(packed: Callable[..., Path]) -> None:
    rng = np.random.default_rng(9)
    refused = 0
    for number in range(150):
        data = bytearray(stream(sequential=bool(number % 2)))
        if number % 3 == 0:
            data = data[: rng.integers(len(data))]
        else:
            for at in rng.integers(0, len(data), 3):
                data[at] = rng.integers(256)
        try:
            read_glb(packed(bytes(data)))
        except BuildingError:
            refused += 1
    assert 50 < refused < 150


def test_without_dracopy_it_says_what_to_do(packed: Callable[..., Path], monkeypatch: pytest.MonkeyPatch) -> None:
    path = packed(stream())
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(
        BuildingError, match=r"pip install 'surveilnav\[mesh\]', or convert it: npx @gltf-transform/cli"
    ):
        read_glb(path)
