from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from surveilnav.errors import BuildingError
from surveilnav.simulator.furniture.models import Model, builtin_materials, load_model

SQUARE = (
    b"mtllib A.MTL\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    b"g one\nusemtl leaf\nf 1/1 2/2 3/3\ng two\nusemtl Amber\nf 1/1 3/3 4/4\n"
)
MTL = b"newmtl LEAF\nKd 0 0 0\nmap_Kd textures\\my leaf.PNG\n"


def picture(alpha_right: int) -> bytes:
    image = np.full((32, 32, 4), 255, np.uint8)
    image[..., 0] = 10
    image[:, 16:, 3] = alpha_right
    return cv2.imencode(".png", image)[1].tobytes()


def archive(**more: bytes) -> dict[str, bytes]:
    return {"m/thing.obj": SQUARE, "m/a.mtl": MTL, "m/my leaf.png": picture(255), **more}


def load(files: dict[str, bytes], cache: Path | None = None) -> Model:
    return load_model("m/thing.obj", lambda name: files.get(name.lower()), cache)


def area(model: Model, material: int) -> float:
    p = model.vertices[model.triangles[model.material == material]].astype(float)
    return float(np.linalg.norm(np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]), axis=1).sum() / 2)


def test_materials_come_from_the_mtl_else_from_java_3d() -> None:
    model = load(archive())
    by_name = {m.name: m for m in model.materials}
    assert by_name["leaf"].texture is not None
    assert by_name["leaf"].color == (1.0, 1.0, 1.0)  # a picture keeps its own colours, whatever Kd says
    assert by_name["leaf"].texture[0, 0].tolist() == [255, 255, 10]
    assert by_name["Amber"].color == builtin_materials()["amber"].color


def test_a_missing_picture_leaves_the_colour() -> None:
    files = archive()
    del files["m/my leaf.png"]
    leaf = next(m for m in load(files).materials if m.name == "leaf")
    assert (leaf.texture, leaf.color) == (None, (0.0, 0.0, 0.0))


def test_transparent_parts_of_a_picture_are_cut_away() -> None:
    model = load(archive(**{"m/my leaf.png": picture(0)}))
    leaf = next(i for i, m in enumerate(model.materials) if m.name == "leaf")
    # Of the lower right triangle, the part with x < 0.5 stays: an eighth of the square.
    assert area(model, leaf) == pytest.approx(0.125, abs=0.02)
    kept = model.vertices[model.triangles[model.material == leaf]]
    assert kept[..., 0].max() < 0.6
    assert area(model, leaf + 1) == pytest.approx(0.5)


def test_groups_can_be_left_away() -> None:
    model = load(archive()).without_groups(lambda name: name == "two")
    assert len(model.triangles) == 1
    assert model.group_names[model.group[0]] == "one"


def test_the_cache_gives_the_same_model_and_survives_damage(tmp_path: Path) -> None:
    cache = tmp_path / "deep" / "thing.npz"
    first = load(archive(), cache)
    assert cache.is_file()
    second = load({}, cache)  # nothing to read: it comes from the cache
    for name in ("vertices", "triangles", "uvs", "material", "group"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert [m.color for m in first.materials] == [m.color for m in second.materials]
    assert first.group_names == second.group_names
    whole = cache.read_bytes()
    for damaged in (b"", b"nonsense", whole[: len(whole) // 2]):
        cache.write_bytes(damaged)
        np.testing.assert_array_equal(load(archive(), cache).vertices, first.vertices)
    assert [p.name for p in cache.parent.iterdir()] == ["thing.npz"]


def test_a_cache_that_cannot_be_written_only_costs_time(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    assert len(load(archive(), tmp_path / "file" / "x.npz").triangles) == 2


def test_what_is_missing_or_no_obj_is_named() -> None:
    with pytest.raises(BuildingError, match=r"no model 'm/thing\.obj'"):
        load({})
    with pytest.raises(BuildingError, match="no OBJ file"):
        load_model("a/b.dae", lambda _: b"<COLLADA/>")


def test_pictures_outside_of_the_models_folder_are_not_asked_for() -> None:
    asked: list[str] = []

    def read(name: str) -> bytes | None:
        asked.append(name)
        return {"m/thing.obj": SQUARE, "m/a.mtl": b"newmtl leaf\nmap_Kd ../../../etc/passwd\n"}.get(name.lower())

    load_model("m/thing.obj", read)
    assert not any(".." in name for name in asked)
