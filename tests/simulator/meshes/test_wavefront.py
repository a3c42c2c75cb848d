"""OBJ files of whole buildings, and the command that converts."""

from __future__ import annotations

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.meshes.__main__ import main
from surveilnav.simulator.sources import open_building


def write_hall(path: Path, corners: np.ndarray, groups: tuple[str, ...] = ("Floor", "Ceiling", "Walls")) -> Path:
    """An OBJ with the hall's triangles in groups of 2, 2 and 8, the floor with a picture."""
    lines = ["mtllib hall.mtl"]
    lines += [f"v {x} {y} {z}" for x, y, z in corners.reshape(-1, 3)]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1"]
    for name, triangles in zip(groups, (range(2), range(2, 4), range(4, 12)), strict=True):
        lines += [f"g {name}", f"usemtl {name.lower()}"]
        lines += [f"f {3 * t + 1}/1 {3 * t + 2}/2 {3 * t + 3}/3" for t in triangles]
    path.write_text("\n".join(lines))
    (path.parent / "hall.mtl").write_text("newmtl floor\nmap_Kd tiles.png\nnewmtl walls\nKd 0.25 0.5 0.75\n")
    picture = np.full((1024, 8, 3), (30, 20, 10), np.uint8)
    cv2.imwrite(str(path.parent / "tiles.png"), picture)
    return path


def test_an_obj_has_a_thing_per_group(tmp_path: Path, corners: np.ndarray) -> None:
    scene = open_building(str(write_hall(tmp_path / "My hall.obj", corners)))
    assert scene.name == "My_hall"
    assert {i.name: i.label for i in scene.instances} == {"Floor": "floor", "Ceiling": "ceiling", "Walls": "wall"}
    assert [(f.id, f.z_m, f.height_m) for f in scene.floors] == [("0", 0.0, pytest.approx(3.0))]
    materials = {m.name: m for m in scene.materials}
    assert materials["walls"].color == (0.25, 0.5, 0.75)
    texture = materials["floor"].texture
    assert texture is not None
    assert texture.shape == (1024, 8, 3)  # not reduced to the size that does for a chair
    assert texture[0, 0].tolist() == [10, 20, 30]


def test_pictures_outside_of_the_folder_are_not_read(tmp_path: Path, corners: np.ndarray) -> None:
    inside = tmp_path / "in"
    inside.mkdir()
    path = write_hall(inside / "a.obj", corners)
    (inside / "tiles.png").rename(tmp_path / "tiles.png")
    (inside / "tiles.png").symlink_to(tmp_path / "tiles.png")
    (material,) = (m for m in open_building(str(path)).materials if m.name == "floor")
    assert material.texture is None


@pytest.mark.parametrize(
    "text", ["", "v 0 0 0\n", "v a b c\nf 1 1 1\n", "v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "\x00\x01"]
)
def test_what_is_no_obj_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.obj"
    path.write_text(text)
    with pytest.raises(BuildingError, match=r"bad\.obj"):
        open_building(str(path))


def test_files_that_are_not_there(tmp_path: Path) -> None:
    for name in ("a.obj", "a.glb", "a.gltf"):
        with pytest.raises(BuildingError, match="there is no file"):
            open_building(str(tmp_path / name))


def test_a_scan_in_millimetres_with_z_up_is_converted(
    tmp_path: Path, corners: np.ndarray, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("trimesh")
    z_up = np.stack([corners[..., 0], -corners[..., 2], corners[..., 1]], axis=-1) * 1000
    path, out = write_hall(tmp_path / "mm.obj", z_up), tmp_path / "m.glb"
    with pytest.raises(BuildingError, match=r"--scale 0\.001"):
        open_building(str(path))
    monkeypatch.setattr(sys, "argv", ["meshes", str(path), str(out), "--up", "z", "--scale", "0.001"])
    assert main() == 0
    assert "floor 0 at 0.00 m" in capsys.readouterr().out
    scene = open_building(str(out))
    assert np.ptp(scene.vertices, axis=0) == pytest.approx([6, 5, 3])
    assert [i.label for i in scene.instances] == ["floor", "ceiling", "wall"]
    monkeypatch.setattr(sys, "argv", ["meshes", str(tmp_path / "none.obj"), str(out)])
    assert main() == 1
    assert "there is no file" in capsys.readouterr().err
