"""GLBs as people and programs make them, and as they arrive broken."""

from __future__ import annotations

import json
import struct
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes import export_glb, gltf
from surveilnav.simulator.meshes.gltf import read_glb
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.scene import Scene

trimesh = pytest.importorskip("trimesh")

Hall = Callable[..., Path]
SIZE_M = (6.0, 5.0, 3.0)


def size_of(scene: Scene) -> tuple[float, ...]:
    return tuple(np.round(np.ptp(scene.vertices, axis=0), 4).tolist())


def test_the_axis_that_points_up_becomes_z(hall: Hall) -> None:
    scene = open_building(str(hall()))
    assert size_of(scene) == SIZE_M
    assert [(f.id, f.z_m, f.height_m) for f in scene.floors] == [("0", 0.0, pytest.approx(3.0))]
    # x stays, glTF's -z (away from the viewer) is our +y: right-handed both.
    assert scene.vertices.min(axis=0) == pytest.approx([0, 0, 0])
    assert scene.instances[0].name == "hall"


def test_transforms_nest_and_mirrors_keep_the_outside_outside(hall: Hall) -> None:
    turned = [0.0, np.sin(0.4), 0.0, np.cos(0.4)]

    def nest(header: dict[str, Any]) -> None:
        header["scenes"] = [{"nodes": [1]}]
        header["nodes"][0]["scale"] = [-1.0, 1.0, 1.0]
        header["nodes"].append({"name": "a", "children": [2], "translation": [1, 2, 3], "scale": [2, 2, 2]})
        header["nodes"].append({"name": "b", "children": [0], "rotation": turned, "translation": [0, 1, 0]})

    scene = open_building(str(hall(nest)))
    angle = 0.8
    R = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    corner = np.array([1, 2, 3]) + 2 * (R @ np.array([-6.0, 0.0, -5.0]) + [0, 1, 0])
    expected = np.array([corner[0], -corner[2], corner[1]])
    assert np.linalg.norm(scene.vertices - expected, axis=1).min() < 1e-4
    assert scene.floors[0].z_m == pytest.approx(4.0)
    p = scene.vertices[scene.triangles].astype(float)
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    assert (normal[p[:, :, 2].max(axis=1) < 4.01][:, 2] > 0).all()  # the floor still looks up


def test_a_mesh_without_pictures_keeps_its_colour(hall: Hall) -> None:
    def paint(header: dict[str, Any]) -> None:
        header["materials"] = [{"name": "paint", "pbrMetallicRoughness": {"baseColorFactor": [0.002, 0.2, 1.0, 1.0]}}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    (material,) = open_building(str(hall(paint))).materials
    assert material.texture is None
    # Linear in the file, sRGB in a scene (IEC 61966-2-1).
    assert material.color == pytest.approx((12.92 * 0.002, 0.4845, 1.0), abs=1e-3)


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_vertex_colours_become_surfaces(tmp_path: Path, hall: Hall, dtype: type) -> None:
    mesh = trimesh.load(hall(), force="mesh", process=False)
    colors = np.tile([0.2, 0.5, 0.8, 1.0], (len(mesh.vertices), 1))
    colors[:6] = [1.0, 0.0, 0.0, 1.0]  # the floor
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=(colors * 255).astype(np.uint8))
    path = tmp_path / "painted.glb"
    path.write_bytes(mesh.export(file_type="glb"))
    scene = open_building(str(path))
    seen = {}
    for t, corners in enumerate(scene.vertices[scene.triangles]):
        texture = scene.materials[scene.material_of_triangle[t]].texture
        assert texture is not None
        u, v = scene.uvs[t].mean(axis=0)
        seen[corners[:, 2].max() < 0.01] = texture[int((1 - v) * len(texture)), int(u * texture.shape[1])]
    assert seen[True].tolist() == [255, 0, 0]
    assert seen[False][0] < seen[False][1] < seen[False][2]


def test_parts_without_a_class_join_the_named_node_above(hall: Hall) -> None:
    def furnish(header: dict[str, Any]) -> None:
        small = {"mesh": 0, "scale": [0.1, 0.1, 0.1], "translation": [1, 0, -1]}
        header["nodes"] += [
            {"name": "Living room", "children": [2, 4, 5]},
            {"name": "Sofa.001", "children": [3, 6]},
            {**small, "name": "Mesh_12"},
            {**small, "name": "thing", "extras": {"label": "tv_monitor"}},
            {**small, "name": "Floor lamp"},
            {**small, "name": "chair-ish", "extras": {"category": "none of them"}},
        ]
        header["scenes"] = [{"nodes": [0, 1]}]

    scene = open_building(str(hall(furnish)))
    assert {i.name: i.label for i in scene.instances} == {
        "hall": "",
        "Sofa.001": "couch",
        "thing": "tv",
        "Floor lamp": "",
        "chair-ish": "none of them",
    }


def test_triangles_that_are_not_finite_are_left_out_and_noted(hall: Hall, corners: np.ndarray) -> None:
    bad = np.concatenate([corners, corners[:2]])
    bad[12, 0, 0], bad[13, 1, 1] = np.nan, np.inf
    scene = open_building(str(hall(corners=bad)))
    assert len(scene.triangles) == 12
    assert np.isfinite(scene.vertices).all()
    assert any("2 triangles" in note for note in scene.notes)


BROKEN: dict[str, tuple[Callable[[dict[str, Any]], object], str]] = {
    "ktx2": (lambda h: h.update(extensionsRequired=["KHR_texture_basisu"]), "plain GLB"),
    "meshopt": (
        lambda h: h.update(extensionsRequired=["EXT_meshopt_compression"]),
        "npx @gltf-transform/cli dequantize",
    ),
    "quantised": (
        lambda h: h.update(extensionsRequired=["KHR_mesh_quantization"]),
        "npx @gltf-transform/cli dequantize",
    ),
    "unknown": (lambda h: h.update(extensionsRequired=["ACME_blobs"]), "ACME_blobs"),
    "outside": (lambda h: h["buffers"][0].update(uri="../secret.bin"), "other files"),
    "count": (lambda h: h["accessors"][0].update(count=10**12), "entries"),
    "zeros": (lambda h: (h["accessors"][0].pop("bufferView"), h["accessors"][0].update(count=10**8)), "entries"),
    "beyond": (lambda h: h["bufferViews"][0].update(byteLength=10**6), "damaged"),
    "no such mesh": (lambda h: h["nodes"][0].update(mesh=7), "no triangles"),
    "no such accessor": (lambda h: h["meshes"][0]["primitives"][0]["attributes"].update(POSITION=9), "damaged"),
    "nodes": (lambda h: h.update(nodes="none"), "damaged"),
    "empty": (lambda h: h.update(meshes=[], nodes=[], scenes=[{"nodes": []}]), "no triangles"),
    "sparse": (lambda h: h["accessors"][0].update(sparse={}), "sparse"),
    "lines": (lambda h: h["meshes"][0]["primitives"][0].update(mode=1), "no triangles"),
    "tiny": (lambda h: h["nodes"][0].update(scale=[0.001] * 3), "metres"),
    "huge": (lambda h: h["nodes"][0].update(scale=[1000] * 3), "metres"),
    "on its side": (lambda h: h["nodes"][0].update(scale=[1, 0.4, 1]), "no floor"),
    "flat": (lambda h: h["nodes"][0].update(scale=[0, 1, 0]), "metres"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_bad_files_are_refused_by_name(hall: Hall, case: str) -> None:
    change, says = BROKEN[case]
    with pytest.raises(BuildingError, match=says) as caught:
        open_building(str(hall(change)))
    assert len(str(caught.value)) < 400


def test_nodes_in_a_circle_end(hall: Hall) -> None:
    def circle(header: dict[str, Any]) -> None:
        header["nodes"][0]["children"] = [1]
        header["nodes"].append({"children": [0]})

    assert size_of(open_building(str(hall(circle)))) == SIZE_M


def test_too_many_triangles_are_refused_before_they_fill_the_memory(
    hall: Hall, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gltf, "MAX_TRIANGLES", 100)
    path = hall(lambda h: (h["nodes"].extend([{"mesh": 0}] * 20), h["scenes"][0]["nodes"].extend(range(1, 21))))
    with pytest.raises(BuildingError, match="more than 100 triangles"):
        open_building(str(path))


def test_files_over_the_limit_are_not_read(hall: Hall, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gltf, "MAX_BYTES", 100)
    with pytest.raises(BuildingError, match="simplify"):
        open_building(str(hall()))


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "no GLB"),
        (b"PK\x03\x04 a zip file", "no GLB"),
        (b'{"asset": {}}', "no GLB"),
        (struct.pack("<4sII", b"glTF", 1, 12), "glTF 1"),
        (struct.pack("<4sII", b"glTF", 2, 12), "no JSON"),
        (struct.pack("<4sII", b"glTF", 2, 99), "cut short"),
        (struct.pack("<4sIII4s", b"glTF", 2, 20, 2**31, b"JSON"), "cut short"),
        (struct.pack("<4sIII4s4s", b"glTF", 2, 24, 4, b"JSON", b"nope"), "no JSON"),
        (struct.pack("<4sIII4s4s", b"glTF", 2, 24, 4, b"JSON", b"[1] "), "not an object"),
    ],
)
def test_what_is_no_glb_is_refused(tmp_path: Path, data: bytes, says: str) -> None:
    path = tmp_path / "a.glb"
    path.write_bytes(data)
    with pytest.raises(BuildingError, match=says):
        open_building(str(path))


def test_damage_anywhere_is_met(tmp_path: Path) -> None:
    path = tmp_path / "flat.glb"
    export_glb(open_building("parametric_flat"), path)
    whole = path.read_bytes()
    (length,) = struct.unpack_from("<I", whole, 12)
    rng = np.random.default_rng(7)
    refused = 0
    for number in range(60):
        data = bytearray(whole)
        if number % 4 == 0:
            data = data[: rng.integers(len(data))]
        else:  # digits and brackets of the header are worth more than its letters
            header = json.loads(whole[20 : 20 + length])
            _mutate(header, rng)
            text = json.dumps(header).encode()
            text += b" " * (-len(text) % 4)
            data = bytearray(
                struct.pack("<4sIII4s", b"glTF", 2, len(text) + len(whole) - length, len(text), b"JSON")
                + text
                + whole[20 + length :]
            )
        path.write_bytes(data)
        try:
            read_glb(path)
        except BuildingError:
            refused += 1
    assert 15 < refused < 60


def _mutate(value: Any, rng: np.random.Generator) -> None:
    """Puts something absurd somewhere into a JSON value."""
    keys = list(value) if isinstance(value, dict) else list(range(len(value)))
    if not keys:
        return
    key = keys[rng.integers(len(keys))]
    if isinstance(value[key], dict | list) and rng.random() < 0.75:
        _mutate(value[key], rng)
    else:
        value[key] = (None, -1, 1e30, "x", [], {}, 2**40, True, [1], float("nan"))[rng.integers(10)]


def test_without_trimesh_it_says_what_to_install(hall: Hall, monkeypatch: pytest.MonkeyPatch) -> None:
    path = hall()
    monkeypatch.setitem(sys.modules, "trimesh.exchange.gltf", None)
    with pytest.raises(BuildingError, match=r"pip install 'surveilnav\[mesh\]'"):
        open_building(str(path))


def test_pictures_that_cannot_be_read_are_noted(hall: Hall) -> None:
    def picture(header: dict[str, Any]) -> None:
        header["images"] = [{"bufferView": 0, "mimeType": "image/webp"}]
        header["textures"] = [{"source": 0}]
        header["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    assert any("1 of 1 pictures" in note for note in open_building(str(hall(picture))).notes)
