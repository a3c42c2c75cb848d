from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from surveilnav.contract import CAMERA_INFO
from surveilnav.errors import AssetError, BuildingError
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator import sources
from surveilnav.simulator.sources import EXAMPLE_HOMES, list_buildings, open_building
from surveilnav.simulator.world.labels import TARGETS
from surveilnav.simulator.world.raycast import RayCaster
from surveilnav.simulator.world.scene import Scene

PLAN = """<home version='7000' name='x' wallHeight='250'>
 <level id='down' name='Ground' elevation='0' floorThickness='12' height='250'/>
 <level id='up' name='Upper' elevation='262' floorThickness='12' height='250'/>
 <wall id='a' level='down' wallAtEnd='b' xStart='0' yStart='0' xEnd='600' yEnd='0' thickness='20' height='250'/>
 <wall id='b' level='down' wallAtStart='a' xStart='600' yStart='0' xEnd='600' yEnd='400' thickness='20' height='250'/>
 <room name='Living room' level='down'><point x='0' y='0'/><point x='600' y='0'/><point x='600' y='400'/>
  <point x='0' y='400'/></room>
 <room level='up'><point x='0' y='0'/><point x='600' y='0'/><point x='600' y='400'/><point x='0' y='400'/></room>
 <doorOrWindow level='down' name='Door' catalogId='eTeks#door' x='300' y='0' width='90' depth='20' height='208'/>
 <pieceOfFurniture level='down' name='My own thing' model='0/thing.obj' x='100' y='100'
  width='50' depth='50' height='50'/>
 <pieceOfFurniture level='down' name='Sofa' model='9/missing.obj' x='200' y='300' width='180' depth='80' height='80'/>
 <pieceOfFurniture level='up' name='Flat TV' model='8/model.dae' x='200' y='300' width='100' depth='20' height='60'/>
</home>"""
OBJ = b"mtllib thing.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nusemtl red\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"


@pytest.fixture
def no_assets(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> Path:
        raise AssetError("none here")

    monkeypatch.setattr(sources, "ensure_assets", refuse)


def sh3d(path: Path, plan: str = PLAN, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("Home.xml", plan)
        file.writestr("0/thing.obj", OBJ)
        file.writestr("0/thing.mtl", "newmtl red\nKd 1 0 0\n")
        file.writestr("8/model.dae", "<COLLADA/>")
        for name, data in members.items():
            file.writestr(name, data)
    return path


def check(scene: Scene) -> None:
    """What everybody may rely on."""
    count = len(scene.triangles)
    assert scene.vertices.dtype == np.float32
    assert np.isfinite(scene.vertices).all()
    assert scene.triangles.dtype == np.int32
    assert scene.triangles.min() >= 0
    assert scene.triangles.max() < len(scene.vertices)
    assert scene.uvs.shape == (count, 3, 2)
    assert scene.uvs.dtype == np.float32
    assert scene.material_of_triangle.shape == (count,)
    assert scene.material_of_triangle.dtype == np.int32
    assert scene.material_of_triangle.max() < len(scene.materials)
    assert scene.instance_of_triangle.dtype == np.uint16
    assert [i.id for i in scene.instances] == list(range(1, len(scene.instances) + 1))
    assert set(scene.instance_of_triangle) == {i.id for i in scene.instances}
    floors = {f.id for f in scene.floors}
    assert {i.floor for i in scene.instances} <= floors
    assert {r.floor for r in scene.rooms} <= floors
    assert [f.z_m for f in scene.floors] == sorted(f.z_m for f in scene.floors)
    for floor in floors:  # a floor's id can stand in a key
        CAMERA_INFO.key_for(building="x", floor=floor, camera="c")
    for i in scene.instances[:: max(1, len(scene.instances) // 20)]:
        p = scene.vertices[scene.triangles[scene.instance_of_triangle == i.id]].reshape(-1, 3)
        np.testing.assert_allclose(p.min(axis=0), i.p_min, atol=1e-5)
        np.testing.assert_allclose(p.max(axis=0), i.p_max, atol=1e-5)


@pytest.mark.parametrize("name", ["parametric_flat", "parametric_house"])
def test_parametric_homes(name: str) -> None:
    scene = open_building(name)
    check(scene)
    assert {i.label for i in scene.instances} >= set(TARGETS)
    assert open_building(name).content_hash == scene.content_hash
    assert open_building(name, seed=1).content_hash != scene.content_hash


def test_the_parametric_house_has_a_stair_with_free_ends() -> None:
    scene = open_building("parametric_house")
    (stair,) = scene.stairs
    assert (stair.lower_floor, stair.upper_floor) == ("0", "1")
    rays = RayCaster(scene)
    for p in (stair.lower_m, stair.upper_m):
        for dx, dy in ((0, 0), (0.2, 0), (-0.2, 0), (0, 0.2), (0, -0.2)):
            origin = np.array([[p[0] + dx, p[1] + dy, p[2] + 1.5]], np.float32)
            down = rays.cast(origin, np.array([[0, 0, -1]], np.float32))
            assert down.t[0] == pytest.approx(1.5, abs=0.02)


def test_doors_of_the_flat_let_a_ray_through() -> None:
    rays = RayCaster(open_building("parametric_flat"))
    origin, direction = np.array([[8.0, 3.0, 1.0]], np.float32), np.array([[0, 1, 0]], np.float32)
    assert rays.cast(origin, direction).t[0] == pytest.approx(
        4.85 - 3.0, abs=0.01
    )  # through the door, to the next wall
    assert rays.cast(origin + np.array([1, 0, 0], np.float32), direction).t[0] == pytest.approx(0.55, abs=0.01)


@pytest.mark.usefixtures("no_assets")
def test_a_users_file_works_without_any_assets(tmp_path: Path) -> None:
    scene = open_building(str(sh3d(tmp_path / "my home.sh3d")), cache_dir=tmp_path)
    check(scene)
    assert scene.name == "my_home-s0"
    assert [f.id for f in scene.floors] == ["0", "1"]
    by_name = {i.name: i for i in scene.instances}
    own = by_name["My own thing"]
    np.testing.assert_allclose(own.p_min, (0.75, -1.25, 0.0), atol=1e-5)
    np.testing.assert_allclose(own.p_max, (1.25, -0.75, 0.5), atol=1e-5)
    red = scene.materials[scene.material_of_triangle[scene.instance_of_triangle == own.id][0]]
    assert red.color == (1.0, 0.0, 0.0)
    assert (by_name["Sofa"].label, by_name["Sofa"].model, by_name["Sofa"].room) == (
        "couch",
        "parametric/couch",
        "Living room",
    )
    assert (by_name["Flat TV"].label, by_name["Flat TV"].floor) == ("tv", "1")
    assert by_name["Flat TV"].p_min[2] == pytest.approx(2.62)
    notes = " ".join(scene.notes)
    assert "none here" in notes
    assert "Sofa" in notes
    # The door is a hole in the wall, and there is floor in it.
    rays = RayCaster(scene)
    origin = np.array([[3.0, -0.5, 1.0], [4.5, -0.5, 1.0]], np.float32)
    t = rays.cast(origin, np.array([[0, 1, 0], [0, 1, 0]], np.float32)).t
    assert np.isinf(t[0])
    assert t[1] == pytest.approx(0.4, abs=1e-3)
    down = rays.cast(np.array([[3.0, 0.05, 1.0]], np.float32), np.array([[0, 0, -1]], np.float32))
    assert down.t[0] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.usefixtures("no_assets")
def test_a_bare_home_xml(tmp_path: Path) -> None:
    (tmp_path / "Home.xml").write_text("\ufeff" + PLAN, encoding="utf-8")
    scene = open_building(str(tmp_path / "Home.xml"), cache_dir=tmp_path)
    assert {i.label for i in scene.instances} >= {"couch", "tv", "wall", "floor", "ceiling"}


@pytest.mark.usefixtures("no_assets")
@pytest.mark.parametrize(
    ("members", "says"),
    [
        ({"../x": b""}, "points outside"),
        ({"bomb": b"\0" * (4 << 20)}, "zip bomb"),
    ],
)
def test_hostile_files_are_refused(tmp_path: Path, members: dict[str, bytes], says: str) -> None:
    with pytest.raises(BuildingError, match=says):
        open_building(str(sh3d(tmp_path / "h.sh3d", **members)), cache_dir=tmp_path)


@pytest.mark.usefixtures("no_assets")
def test_an_obj_bomb_becomes_a_stand_in_with_a_note(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from surveilnav.simulator.furniture import objfile

    monkeypatch.setattr(objfile, "MAX_VERTICES", 3)
    scene = open_building(str(sh3d(tmp_path / "h.sh3d")), cache_dir=tmp_path)
    assert any("more than 3 vertices" in note for note in scene.notes)
    assert next(i for i in scene.instances if i.name == "My own thing").model.startswith("parametric/")


@pytest.mark.usefixtures("no_assets")
def test_many_copies_of_a_model_stop_at_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from surveilnav.simulator.world.assembly import SceneBuilder

    monkeypatch.setattr(SceneBuilder, "__init__", _limited(SceneBuilder.__init__))
    with pytest.raises(BuildingError, match="triangles"):
        open_building(str(sh3d(tmp_path / "h.sh3d")), cache_dir=tmp_path)


def _limited(original):  # type: ignore[no-untyped-def]
    def init(self, *args, **more):  # type: ignore[no-untyped-def]
        original(self, *args, **more)
        self.max_triangles = 10

    return init


@pytest.mark.usefixtures("no_assets")
@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "cut short"),
        (b"PK\x03\x04 and then nothing", "cut short"),
        (b"<!DOCTYPE home [<!ENTITY a 'a'>]><home/>", "refused"),
        (b"<html/>", "expected a <home>"),
    ],
)
def test_files_that_are_none(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "x.sh3d"
    path.write_bytes(content)
    with pytest.raises(BuildingError, match=says):
        open_building(str(path), cache_dir=tmp_path)


@pytest.mark.parametrize(
    "name", ["no_such_home", "", "missing.sh3d", "/", "x" * 5000, "a\0b.sh3d", "~nobody_here/x.sh3d"]
)
def test_unknown_buildings_list_the_valid_ones_or_say_why(name: str, tmp_path: Path) -> None:
    with pytest.raises(BuildingError, match=r"studio|can't be opened"):
        open_building(name, cache_dir=tmp_path)


def test_a_near_miss_is_suggested(tmp_path: Path) -> None:
    with pytest.raises(BuildingError, match="did you mean '2_bedroom_basement'"):
        open_building("2_bedroom_basment", cache_dir=tmp_path)


@pytest.mark.usefixtures("no_assets")
def test_example_homes_need_assets(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="none here"):
        open_building("studio", cache_dir=tmp_path)


def test_the_list_of_buildings() -> None:
    names = [*EXAMPLE_HOMES, "office_<n>", "flats_<n>", "parametric_flat", "parametric_house"]
    assert [b.name for b in list_buildings()] == names
    assert len(EXAMPLE_HOMES) == 9


@pytest.mark.assets
@pytest.mark.usefixtures("assets")
@pytest.mark.parametrize(
    ("name", "floors", "targets"),
    [
        ("studio", ["0"], {"bed": 1, "toilet": 1}),
        ("2_bedroom_basement", ["B1", "0"], {"bed": 2, "couch": 1, "chair": 9, "toilet": 1, "potted plant": 2}),
        ("3_bedroom_attic", ["0", "1", "2"], {"bed": 3, "chair": 12, "toilet": 2, "tv": 1, "potted plant": 14}),
        ("3_bedroom_mezzanine", ["0", "1"], {"bed": 4, "couch": 4, "chair": 14, "toilet": 3, "tv": 1}),
    ],
)
def test_example_homes(name: str, floors: list[str], targets: dict[str, int]) -> None:
    scene = open_building(name)
    check(scene)
    assert [f.id for f in scene.floors] == floors
    assert {label: len(scene.labelled(label)) for label in targets} == targets
    assert len(scene.stairs) == len(floors) - 1
    assert [note for note in scene.notes if "level 'Roof' is no floor" not in note] == []
    assert any("CC BY" in credit for credit in scene.credits)


@pytest.mark.assets
@pytest.mark.usefixtures("assets")
def test_a_seed_is_a_way_of_furnishing() -> None:
    first, second, again = (open_building("2_bedroom", seed=s) for s in (0, 1, 0))
    assert first.content_hash == again.content_hash
    assert first.content_hash != second.content_hash
    assert [i.label for i in first.instances] == [i.label for i in second.instances]
    changed = [a.model != b.model for a, b in zip(first.instances, second.instances, strict=True) if a.label in TARGETS]
    assert any(changed)


@pytest.mark.assets
@pytest.mark.usefixtures("assets")
def test_models_that_no_detector_knows_are_gone() -> None:
    for seed in (0, 1):
        models = {i.model for i in open_building("3_bedroom_mezzanine", seed=seed).instances}
        assert not models & {"eTeks#cornerSofa", "Blend Swap CC-BY#cornerSofa", "Blend Swap CC-0#decorativePlant"}


@pytest.mark.assets
@pytest.mark.usefixtures("assets")
def test_a_second_opening_reads_the_parsed_models(tmp_path: Path, assets: Path) -> None:
    (tmp_path / "assets").mkdir()
    (tmp_path / "assets" / "sweethome3d").symlink_to(assets)
    first = open_building("studio", cache_dir=tmp_path)
    files = list(tmp_path.glob("models-*/*.npz"))
    assert len(files) > 10
    for file in files[::2]:  # damaged files are parsed anew, not believed
        file.write_bytes(b"PK nonsense")
    assert open_building("studio", cache_dir=tmp_path).content_hash == first.content_hash


@pytest.mark.assets
@pytest.mark.usefixtures("assets")
def test_the_truth_names_parts_of_the_building_and_all_furniture_too() -> None:
    """Else a detector that errs like a real one takes doors for beds as often as desks, and a bath for an oven."""
    scene = open_building("studio")
    parts = {i: label for i, label in scene.truth_labels.items() if i not in scene.labels_by_id}
    assert {"wall", "floor", "ceiling", "door", "window", "cabinet", "lamp"} <= set(parts.values())
    assert not set(parts.values()) & set(COCO)
    assert scene.truth_labels == parts | scene.labels_by_id
    assert "" not in scene.truth_labels.values()


def test_a_home_from_before_version_5_3_is_the_same_building(tmp_path: Path, no_assets: None) -> None:
    homes = Path(__file__).parent / "plans/homes"
    before, since = (open_building(str(homes / f"{when}_5_3.sh3d"), cache_dir=tmp_path) for when in ("before", "since"))
    check(before)
    assert before.instances == since.instances
    assert [floor.id for floor in before.floors] == ["0", "1"]
    assert not [note for note in before.notes if "can't be read" in note]
    assert {i.model for i in before.instances if i.name in ("Bett", "Stuhl")} == {"1/the box.obj"}


def test_home_xml_is_preferred_and_a_file_with_neither_is_told_so(tmp_path: Path, no_assets: None) -> None:
    assert open_building(str(sh3d(tmp_path / "both.sh3d", Home=b"never read")), cache_dir=tmp_path).floors
    with zipfile.ZipFile(tmp_path / "neither.sh3d", "w") as file:
        file.writestr("ContentDigests", b"")
    with pytest.raises(BuildingError, match=r"neither a Home\.xml nor a Home .before version 5\.3."):
        open_building(str(tmp_path / "neither.sh3d"), cache_dir=tmp_path)
