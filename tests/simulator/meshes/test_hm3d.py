"""HM3D's layout: rows, colours, and a plain mesh that is cut otherwise than the painted one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes import export_hm3d
from surveilnav.simulator.meshes.hm3d import read_annotations
from surveilnav.simulator.meshes.names import label_of_hm3d
from surveilnav.simulator.sources import open_building
from surveilnav.simulator.world.navigation import NavigationMap
from surveilnav.simulator.world.scene import Scene

pytest.importorskip("trimesh")


def as_scanned(scene: Scene, edge_m: float, noise_m: float) -> Scene:
    """A scene as a scanner gives it: small triangles, joined, every corner off by some noise."""
    corners, uvs = scene.vertices[scene.triangles].astype(float), scene.uvs.astype(float)
    material, owner = scene.material_of_triangle, scene.instance_of_triangle
    while True:
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        long = np.flatnonzero(edges.max(axis=1) > edge_m)
        if not len(long):
            break
        first = edges[long].argmax(axis=1)
        halves = []
        for array in (corners, uvs):
            a, b, c = (array[long, (first + k) % 3] for k in range(3))
            middle = (a + b) / 2
            short = np.delete(array, long, axis=0)
            halves.append(np.concatenate([short, np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]))
        corners, uvs = halves
        material, owner = (np.concatenate([np.delete(x, long), x[long], x[long]]) for x in (material, owner))
    vertices, index = np.unique(np.round(corners.reshape(-1, 3), 5), axis=0, return_inverse=True)
    vertices = vertices + np.random.default_rng(1).normal(0.0, noise_m, vertices.shape)
    return replace(
        scene,
        vertices=vertices.astype(np.float32),
        triangles=index.reshape(-1, 3).astype(np.int32),
        uvs=uvs.astype(np.float32),
        material_of_triangle=material,
        instance_of_triangle=owner,
    )


@pytest.fixture(scope="module")
def house() -> Scene:
    return open_building("parametric_house")


@pytest.fixture
def folder(tmp_path: Path, house: Scene) -> Path:
    export_hm3d(house, tmp_path / "00812-house")
    return tmp_path / "00812-house"


def test_a_noisy_scan_takes_names_from_a_painted_mesh_that_is_cut_otherwise(folder: Path, house: Scene) -> None:
    export_hm3d(as_scanned(house, 0.2, 0.008), folder.parent / "00001-house")
    (folder.parent / "00001-house" / "house.glb").rename(folder / "house.glb")
    scan = open_building(str(folder))
    assert [f.z_m for f in scan.floors] == pytest.approx([0.0, 2.62], abs=0.05)
    assert [(s.lower_floor, s.upper_floor) for s in scan.stairs] == [("0", "1")]
    # A thing's number in the text is the number in the house.
    found = {int(i.name.split()[-1]): i for i in scan.instances if i.id in scan.labels_by_id}
    assert {n: i.label for n, i in found.items()} == house.labels_by_id
    for number, instance in found.items():
        original = house.instances[number - 1]
        assert instance.floor == original.floor
        np.testing.assert_allclose(
            [instance.p_min, instance.p_max], [original.p_min, original.p_max], atol=0.1, err_msg=instance.name
        )
    before, after = (NavigationMap.build(s) for s in (house, scan))
    for name, floor in before.floors.items():
        assert after.floors[name].free.sum() == pytest.approx(floor.free.sum(), rel=0.05)


def test_a_glb_in_the_folder_means_the_folder(folder: Path) -> None:
    whole, by_file = open_building(str(folder)), open_building(str(folder / "house.glb"))
    assert by_file.content_hash == whole.content_hash
    assert whole.name == "00812_house"
    assert {i.room for i in whole.instances} >= {"region 1", "region 2"}


def edit(folder: Path, change: Callable[[str], str]) -> str:
    text = folder / "house.semantic.txt"
    text.write_text(change(text.read_text()))
    return str(folder)


def test_rows_that_cannot_be_read_are_counted(folder: Path, house: Scene) -> None:
    bad = 'x,AABBCC,"chair",1\n7,GGGGGG,"chair",1\n8,AABB\n\n9,AABBCC,"chair, red, with arms",2\n10,AABBCC,"bed",2\n'
    scene = open_building(edit(folder, lambda text: text + bad))
    (note,) = (n for n in scene.notes if "rows" in n)
    assert "4 rows" in note
    assert any("1 of" in n and "no triangle" in n for n in scene.notes)
    assert len(scene.labels_by_id) == len(house.labels_by_id)


def test_a_name_may_have_commas(tmp_path: Path) -> None:
    path = tmp_path / "a.semantic.txt"
    path.write_text('HM3D Semantic Annotations\n12,A8FFC4,"chair, old, of wood",3\n')
    ((row,), notes) = read_annotations(path)
    assert (row.id, row.color, row.name, row.region) == (12, 0xA8FFC4, "chair, old, of wood", 3)
    assert notes == []


def test_colours_that_the_text_does_not_list_are_noted(folder: Path, house: Scene) -> None:
    beds = [i.id for i in house.labelled("bed")]
    scene = open_building(
        edit(folder, lambda text: "\n".join(line for line in text.splitlines() if '"bed"' not in line))
    )
    assert beds
    assert not scene.labelled("bed")
    (note,) = (n for n in scene.notes if "aren't in the text" in n)
    assert note.startswith(f"{len(beds)} colours")
    assert len(scene.triangles) == len(house.triangles)


@pytest.mark.parametrize("text", ["", "HM3D Semantic Annotations\n", "\x00\xff what is this", "a,b\n" * 50])
def test_a_text_without_rows_is_refused(folder: Path, text: str) -> None:
    with pytest.raises(BuildingError, match="no row that can be read"):
        open_building(edit(folder, lambda _: text))


def test_without_semantic_files_nothing_has_a_name(folder: Path) -> None:
    (folder / "house.semantic.glb").unlink()
    scene = open_building(str(folder))
    assert scene.labels_by_id == {}
    assert any("house.semantic.glb" in note for note in scene.notes)


def test_folders_that_are_none_of_hm3d(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(BuildingError, match="a folder of HM3D"):
        open_building(str(tmp_path))
    (folder / "house.glb").unlink()
    with pytest.raises(BuildingError, match=r"glb-v0\.2"):
        open_building(str(folder))


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("tv_monitor", "tv"),
        ("tv", "tv"),
        ("computer monitor", "tv"),
        ("wall tv", ""),
        ("tv stand", ""),
        ("sofa", "couch"),
        ("couch", "couch"),
        ("Sofa Chair", "chair"),
        ("armchair", "chair"),
        ("stool", ""),
        ("plant", "potted plant"),
        ("potted plant", "potted plant"),
        ("flower pot", ""),
        ("bed sheet", ""),
        ("bed", "bed"),
        ("dog bed", ""),
        ("toilet", "toilet"),
        ("toilet paper", ""),
        ("sink", "sink"),
        ("wall", "wall"),
        ("stair", "stairs"),
        ("door frame", "door"),
        ("Sliding_Door", "door"),
        ("window frame", ""),
        ("unknown", ""),
    ],
)
def test_names_fold_as_habitat_folds_them(name: str, label: str) -> None:
    assert label_of_hm3d(name) == label
