"""A dataset comes out the same, resumes, and its faults are named."""

from __future__ import annotations

import errno
import gzip
import json
import os
import shutil

import pytest

from surveilnav.benchmark.dataset.check import check
from surveilnav.benchmark.dataset.load import load_scene
from surveilnav.benchmark.dataset.make import _work, make, write_manifest
from surveilnav.benchmark.dataset.show import draw
from surveilnav.benchmark.dataset.splits import EDITION, SplitSpec, own_split, quotas, splits_of, take
from surveilnav.benchmark.runner.basis import basis_of
from surveilnav.benchmark.runner.run import run
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.cli.dataset import DEFAULT_ROOT
from surveilnav.errors import ConfigError
from surveilnav.simulator.meshes import export_glb
from surveilnav.simulator.sources import open_building
from tests.benchmark.dataset.conftest import SPLIT


def _bytes(root):
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in sorted(root.rglob("*.json*"))}


@pytest.fixture
def root(dataset, tmp_path):
    """A copy of the dataset, to be spoiled."""
    shutil.copytree(dataset, tmp_path / "copy")
    return tmp_path / "copy"


def test_built_twice_it_is_the_same(dataset, tmp_path):
    make(tmp_path, [SPLIT], workers=2)
    assert _bytes(tmp_path) == _bytes(dataset)


def test_only_what_is_missing_is_built(root, dataset):
    (root / "val_mini" / "scenes" / "parametric_flat-s0.json").unlink()  # as a kill leaves it
    built = []
    make(root, [SPLIT], workers=1, on_progress=lambda done, total, scene: built.append((done, total, scene)))
    assert built == [(1, 1, "parametric_flat-s0")]
    assert _bytes(root) == _bytes(dataset)


@pytest.mark.usefixtures("builds_by_copy")
@pytest.mark.parametrize(
    "spoil",
    [
        lambda folder: (folder / "cameras" / "parametric_flat-s0.json.gz").unlink(),
        lambda folder: (folder / "content" / "parametric_flat-s0.json.gz").write_bytes(b"\x1f\x8b\x08damaged" * 9),
        lambda folder: _flip(folder / "content" / "parametric_flat-s0.json.gz"),
        lambda folder: (folder / "scenes" / "parametric_flat-s0.json").write_text("{}"),
        lambda folder: _edit(folder / "content" / "parametric_flat-s0.json.gz", _start_elsewhere),
    ],
    ids=["missing", "damaged", "flipped", "other format", "changed"],
)
def test_what_is_damaged_is_built_anew(root, dataset, spoil):
    spoil(root / "val_mini")
    assert any("parametric_flat-s0" in f.where for f in check(root, deep=False))
    make(root, [SPLIT], workers=1)
    assert _bytes(root) == _bytes(dataset)


def test_what_was_changed_in_another_split_gets_no_new_hash(root):
    shutil.copytree(root / "val_mini", root / "val")
    (root / "val" / "val_mini.json.gz").rename(root / "val" / "val.json.gz")
    write_manifest(root)
    before = (root / "dataset.json").read_bytes()
    _edit(root / "val" / "content" / "parametric_flat-s0.json.gz", _start_elsewhere)
    with pytest.raises(ConfigError, match=r"val/content/parametric_flat-s0.json.gz .* build val as well"):
        make(root, [SPLIT], workers=1)
    assert (root / "dataset.json").read_bytes() == before


def test_a_full_disk_is_named_and_the_next_build_goes_on(root, dataset, monkeypatch):
    cameras = root / "val_mini" / "cameras" / "parametric_flat-s0.json.gz"
    cameras.unlink()
    real = os.replace

    def full(source, target):
        if target == cameras:
            raise OSError(errno.ENOSPC, "No space left on device")
        real(source, target)

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(ConfigError, match="No space left on device"):
        _work((root, "val_mini", SPLIT.scenes[0], 5))
    monkeypatch.undo()
    assert not list(root.rglob("*.part"))
    make(root, [SPLIT], workers=1)
    assert _bytes(root) == _bytes(dataset)


def _flip(path):
    """Spoils the packed data itself, not its length or its header."""
    data = bytearray(path.read_bytes())
    for at in range(60, 80):
        data[at] ^= 0xFF
    path.write_bytes(data)


@pytest.mark.usefixtures("builds_by_copy")
def test_a_dataset_of_another_version_is_kept_unless_asked(root, dataset):
    _edit(root / "dataset.json", lambda m: m.update(version=1))
    before = _bytes(root)
    with pytest.raises(ConfigError, match=r"version 1.*--anew"):
        make(root, [SPLIT], workers=1)
    assert _bytes(root) == before
    built = []
    make(root, [SPLIT], workers=2, anew=True, on_progress=lambda done, total, scene: built.append(scene))
    assert built == [spec.scene for spec in SPLIT.scenes]
    assert _bytes(root) == _bytes(dataset)


def test_a_split_that_is_half_built_isnt_listed(root):
    shutil.copytree(root / "val_mini", root / "val")
    (root / "val" / "val_mini.json.gz").unlink()  # as a build of val that was stopped leaves it: no index
    assert list(write_manifest(root).splits) == ["val_mini"]


def test_a_sound_dataset_has_no_errors(dataset):
    assert [f for f in check(dataset) if f.level == "error"] == []


def test_counts_that_dont_come_out_are_an_error(root):
    with pytest.raises(ConfigError, match="should have 4 floors"):
        make(root, [SplitSpec("val_mini", SPLIT.scenes, 9, (4, 3))], workers=1)


def _edit(path, change):
    """Of a file of JSON, packed or not."""
    packed = path.suffix == ".gz"
    content = json.loads(gzip.decompress(path.read_bytes()) if packed else path.read_bytes())
    change(content)
    text = json.dumps(content).encode()
    path.write_bytes(gzip.compress(text, 1) if packed else text)


def _start_elsewhere(content):
    """All is well formed, but not what the manifest was written for."""
    content["episodes"][0]["info"]["geodesic_distance"] = 1.0


def _no_number(content):
    next(iter(content["goals_by_category"].values()))[0]["object_id"] = "abc"


def _start_without_place(content):
    content["episodes"][0]["start_position"] = [1.0]


def _start_in_a_wall(content):
    content["episodes"][0]["start_position"] = [-50.0, 0.0, 0.0]


def _no_viewpoint(content):
    goals = next(iter(content["goals_by_category"].values()))
    goals[0]["view_points"] = []


def _no_category(content):
    content["goals_by_category"].pop(next(k for k in content["goals_by_category"] if k.endswith("_toilet")))
    content["episodes"] = [e for e in content["episodes"] if e["object_category"] != "toilet"]
    for i, e in enumerate(content["episodes"]):
        e["episode_id"] = str(i)


def _viewpoint_far_away(content):
    """Of one that isn't the nearest to any start, so no way is wrong."""
    goals = content["goals_by_category"]["parametric_flat-s0.glb_chair"]
    for view_point in goals[-1]["view_points"]:
        view_point["agent_state"]["position"][0] += 50.0


def _goal_left_out(content):
    content["goals_by_category"]["parametric_flat-s0.glb_chair"].pop()


def _goal_twice(content):
    goals = content["goals_by_category"]["parametric_flat-s0.glb_chair"]
    goals.append(goals[0])


def _goal_moved(content):
    content["goals_by_category"]["parametric_flat-s0.glb_chair"][0]["position"][0] += 0.5


def _closest_goal_of_another_category(content):
    content["episodes"][0]["info"]["closest_goal_object_id"] = "36"  # the bed


def _another_scene(content):
    content["episodes"][0]["scene_id"] = "surveilnav/val_mini/castle/castle.glb"


def _goal_that_isnt_there(content):
    next(iter(content["goals_by_category"].values()))[0]["object_id"] = "60000"


@pytest.mark.parametrize(
    ("change", "level", "said"),
    [
        (_start_in_a_wall, "error", "starts where no way leads to a goal"),
        (_no_viewpoint, "error", "no viewpoint: unreachable"),
        (_no_category, "note", "has no toilet"),
        (_goal_that_isnt_there, "error", "with the number 60000"),
        (_viewpoint_far_away, "error", "its viewpoints aren't those from which a robot sees it"),
        (_goal_left_out, "error", "can be reached and isn't among the goals"),
        (_goal_twice, "error", "lists a goal twice"),
        (_goal_moved, "error", "isn't where its file says"),
        (_closest_goal_of_another_category, "error", "its closest goal is none of its category"),
        (_another_scene, "error", "episode 0 is one of the scene surveilnav/val_mini/castle"),
        (_no_number, "error", "holds what can't be"),
        (_start_without_place, "error", "holds what can't be"),
    ],
)
def test_faults_are_named(root, change, level, said):
    _edit(root / "val_mini" / "content" / "parametric_flat-s0.json.gz", change)
    changed = [f.what for f in check(root, deep=False) if f.level == "error"]
    assert any("was changed" in what for what in changed)
    write_manifest(root)  # somebody rebuilt the manifest over it
    found = [f for f in check(root) if said in f.what]
    assert [f.level for f in found][:1] == [level]
    assert "parametric_flat-s0" in found[0].where


@pytest.mark.parametrize("m2", ["100", "200"])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda c, m2: c["cameras"][m2][0].update(position_m=[500.0, 500.0, 100.0]), "sees nothing"),
        (lambda c, m2: c["cameras"][m2][0]["position_m"].__setitem__(2, -0.05), "sees nothing"),
        (lambda c, m2: c["cameras"][m2][0]["position_m"].__setitem__(0, 2.0), "doesn't hang or look as the rule says"),
        (lambda c, m2: c["cameras"][m2][0]["views"].pop(), "has 12 views, expected 13"),
        (lambda c, m2: c["view_bytes"].pop(m2), "bytes of 0 views, it has 13"),
        (lambda c, m2: c["cameras"][m2].pop(), "its floors count 1"),
        (lambda c, m2: c["cameras"].pop(m2), "its floors count 1"),
    ],
    ids=[
        "far away",
        "in the floor slab",
        "elsewhere",
        "few views",
        "not measured",
        "missing",
        "no density",
    ],
)
def test_what_is_wrong_with_a_camera_is_named(root, m2, change, said):
    _edit(root / "val_mini" / "cameras" / "parametric_flat-s0.json.gz", lambda content: change(content, m2))
    write_manifest(root)
    found = [f for f in check(root) if said in f.what]
    assert [f.level for f in found] == ["error"]
    assert f"{m2} m2" in found[0].what


def test_cameras_with_another_lens_are_named(root):
    _edit(root / "val_mini" / "cameras" / "parametric_flat-s0.json.gz", lambda c: c["intrinsics"].update(fx_px=500.0))
    write_manifest(root)
    assert [f.what for f in check(root) if f.level == "error"] == [
        f"cameras per {m2} m2 aren't built or mounted as the rule says" for m2 in (100, 200)
    ]


def test_a_scene_without_its_cameras_is_named(root):
    _edit(
        root / "val_mini" / "cameras" / "parametric_flat-s0.json.gz", lambda c: c.update(cameras={"100": [], "200": []})
    )
    _edit(
        root / "val_mini" / "scenes" / "parametric_flat-s0.json",
        lambda r: r["floors"][0].update(cameras={"100": 0, "200": 0}),
    )
    write_manifest(root)
    assert [f.what for f in check(root) if f.level == "error"] == [
        f"camera c0-1 per {m2} m2 is missing" for m2 in (100, 200)
    ]


def test_a_density_that_is_nowhere_is_named(root):
    _edit(root / "val_mini" / "cameras" / "parametric_flat-s0.json.gz", lambda c: c["cameras"].pop("200"))
    _edit(root / "val_mini" / "scenes" / "parametric_flat-s0.json", lambda r: r["floors"][0]["cameras"].pop("200"))
    write_manifest(root)
    assert [f.what for f in check(root) if f.level == "error"] == ["the dataset has cameras per 100 m2, not per 200"]


def test_files_that_the_manifest_doesnt_know_are_named(root):
    for folder, end in (("scenes", ".json"), ("content", ".json.gz"), ("cameras", ".json.gz")):
        source = root / "val_mini" / folder / f"parametric_flat-s0{end}"
        shutil.copy(source, source.with_name(f"castle-s0{end}"))
    found = [f.where for f in check(root, deep=False) if "isn't in the manifest" in f.what]
    assert len(found) == 3
    assert all("castle-s0" in where for where in found)
    with pytest.raises(ConfigError, match=r"castle-s0.json.gz isn't in the manifest"):
        basis_of(root, "val_mini")
    before = (root / "dataset.json").read_bytes()
    with pytest.raises(ConfigError, match=r"files that are none of val_mini: .*castle-s0.json.gz.*delete them"):
        make(root, [SPLIT], workers=1)
    assert (root / "dataset.json").read_bytes() == before


@pytest.mark.parametrize(
    "name", ["notes.json", "scenes/old/x.json", "content/parametric_flat-s0.json", "more/x.json.gz"]
)
def test_files_that_are_none_of_a_dataset_get_no_hash(root, name):
    (root / "val_mini" / name).parent.mkdir(parents=True, exist_ok=True)
    (root / "val_mini" / name).write_text("{}")
    assert f"val_mini/{name}" in [f.where for f in check(root, deep=False) if "isn't in the manifest" in f.what]
    with pytest.raises(ConfigError, match=f"none of val_mini: val_mini/{name}"):
        make(root, [SPLIT], workers=1)


@pytest.mark.usefixtures("builds_by_copy")
def test_a_split_that_was_stopped_goes_on_beside_one_that_is_whole(root):
    val = SplitSpec("val", SPLIT.scenes, SPLIT.episodes, SPLIT.expected)
    shutil.copytree(root / "val_mini", root / "val")
    (root / "val" / "val_mini.json.gz").unlink()  # no index, not in the manifest
    (root / "val" / "scenes" / "parametric_flat-s0.json").unlink()
    built = []
    make(root, [val], workers=1, on_progress=lambda done, total, scene: built.append((done, total, scene)))
    assert built == [(1, 1, "parametric_flat-s0")]


@pytest.mark.usefixtures("builds_by_copy")
def test_a_split_whose_folder_was_deleted_is_forgotten(root):
    shutil.copytree(root / "val_mini", root / "own")
    (root / "own" / "val_mini.json.gz").rename(root / "own" / "own.json.gz")
    assert set(write_manifest(root).splits) == {"own", "val_mini"}
    (root / "own" / "content" / "parametric_flat-s0.json.gz").unlink()
    with pytest.raises(
        ConfigError, match=r"is missing.*build it with its --building again, or delete the split's folder"
    ):
        make(root, [SPLIT], workers=1)
    shutil.rmtree(root / "own")
    assert set(make(root, [SPLIT], workers=1).splits) == {"val_mini"}


@pytest.mark.usefixtures("builds_by_copy")
def test_files_that_the_manifest_forgot_are_named(root, dataset):
    _edit(
        root / "dataset.json",
        lambda m: m.update(sha256={k: v for k, v in m["sha256"].items() if "/cameras/" not in k}),
    )
    (root / "val_mini" / "cameras" / "parametric_flat-s0.json.gz").unlink()
    assert {(f.where, f.what) for f in check(root, deep=False)} >= {
        ("val_mini/cameras/parametric_flat-s0.json.gz", "is missing, in the manifest, too"),
        ("val_mini/cameras/parametric_house-s1.json.gz", "isn't in the manifest"),
    }
    make(root, [SPLIT], workers=1)
    assert _bytes(root) == _bytes(dataset)


@pytest.mark.usefixtures("builds_by_copy")
@pytest.mark.parametrize("name", ["val_mini/scenes/parametric_flat-s0.json", "dataset.json"])
def test_bytes_that_arent_text_are_named(root, dataset, name):
    data = bytearray((root / name).read_bytes())
    at = data.index(b'": "') + 5
    data[at : at + 2] = b"\xff\xfe"
    (root / name).write_bytes(data)
    if name == "dataset.json":
        with pytest.raises(ConfigError, match=r"dataset.json is damaged.*build the dataset anew"):
            list(check(root, deep=False))
    else:
        assert {f.where for f in check(root, deep=False)} == {name, "val_mini/parametric_flat-s0"}
        make(root, [SPLIT], workers=1)
        assert _bytes(root) == _bytes(dataset)


def test_a_dataset_that_another_program_or_another_rule_made_is_named(root):
    rules = {"cameras": "where it looks nice"}
    _edit(root / "dataset.json", lambda m: m.update(made_by="surveilnav 0.0.1", rules=m["rules"] | rules))
    found = [(f.level, f.what) for f in check(root, deep=False)]
    assert [level for level, _ in found] == ["note", "error"]
    assert "was made by surveilnav 0.0.1, this is" in found[0][1]
    assert "another rule of cameras: 'where it looks nice'" in found[1][1]


def test_a_changed_scene_isnt_drawn(root, tmp_path):
    _edit(root / "val_mini" / "content" / "parametric_flat-s0.json.gz", _start_elsewhere)
    with pytest.raises(ConfigError, match="aren't what they were"):
        draw(root, "val_mini", "parametric_flat-s0", tmp_path / "out")


def test_a_building_that_comes_out_otherwise_is_named(root):
    _edit(root / "val_mini" / "scenes" / "parametric_flat-s0.json", lambda r: r.update(content_hash="0" * 64))
    write_manifest(root)
    assert any("another version of the program" in f.what for f in check(root))


def test_a_damaged_file_is_named(root):
    path = root / "val_mini" / "content" / "parametric_flat-s0.json.gz"
    path.write_bytes(path.read_bytes()[:200])
    assert any("can't be read" in f.what and "parametric_flat-s0" in f.what for f in check(root, deep=False))


def test_quotas_and_categories_are_even():
    assert quotas(1000, 36) == [28] * 28 + [27] * 8
    assert take({"a": 5, "b": 1, "c": 5}, 7) == {"a": 3, "b": 1, "c": 3}
    assert take({"a": 1, "b": 1}, 7) == {"a": 1, "b": 1}
    assert take({"a": 5, "b": 5}, 3, first=1) == {"a": 1, "b": 2}


def test_a_split_of_ones_own_buildings_is_built_checked_and_played(tmp_path):
    """A mesh as somebody has it, and a building that has a name."""
    pytest.importorskip("trimesh")
    export_glb(open_building("parametric_flat"), tmp_path / "my.flat.glb")
    own = own_split("own", [str(tmp_path / "my.flat.glb"), "parametric_flat"], 3)
    assert [spec.scene for spec in own.scenes] == ["my.flat-s0", "parametric_flat-s0"]
    root = tmp_path / "dataset"
    assert make(root, [own], workers=2).splits["own"].episodes == 6
    assert [f for f in check(root) if f.level == "error"] == []
    built = []
    # a name as open_building takes it, too
    fewer = own_split("own", [str(tmp_path / "my.flat.glb"), "Parametric-Flat"], 2)
    make(root, [fewer], workers=2, on_progress=lambda done, total, scene: built.append(scene))
    assert sorted(built) == ["my.flat-s0", "parametric_flat-s0"]
    (tmp_path / "other").mkdir()
    shutil.copy(tmp_path / "my.flat.glb", tmp_path / "other")
    elsewhere = own_split("own", [str(tmp_path / "other" / "my.flat.glb"), "parametric_flat"], 2)
    make(root, [elsewhere], workers=1, on_progress=lambda done, total, scene: built.append(scene))
    assert built[2:] == ["my.flat-s0"]
    settings = RunSettings(split="own", perception="oracle", policy="shortest-path", surveillance=False)
    finished = run(root, tmp_path / "run", settings, workers=2)
    assert finished.complete
    assert {r.scene for r in finished.records if r.success} == {"my.flat-s0", "parametric_flat-s0"}


@pytest.mark.parametrize(
    ("name", "buildings", "said"),
    [
        ("val", ["studio"], "other than val, val_mini, train; got 'val'"),
        ("../up", ["studio"], "letters and digits"),
        ("own", ["studio", "there/studio.glb"], "have the same name"),
        ("own", ["~nobody-of-that-name/studio.glb"], "can't be opened"),
    ],
)
def test_a_split_of_ones_own_that_cant_be_is_named(name, buildings, said):
    with pytest.raises(ConfigError, match=said):
        own_split(name, buildings, 3)


def test_a_building_with_too_few_places_to_start_is_named(root, monkeypatch):
    monkeypatch.setattr("surveilnav.benchmark.dataset.make.is_whole", lambda *_: True)
    with pytest.raises(ConfigError, match=r"parametric_flat should have 6 episodes, it came out with 5.*--episodes"):
        make(root, [SplitSpec("val_mini", SPLIT.scenes, 11)], workers=1)


def test_splits_have_names():
    with pytest.raises(ConfigError, match="there are"):
        splits_of(["vla"])


def test_pictures_show_floors(dataset, tmp_path):
    import cv2

    drawn = draw(dataset, "val_mini", "parametric_house-s1", tmp_path)
    image = cv2.imread(str(drawn.path))
    assert image.shape[1] > 900  # two floors side by side
    assert (image == (0, 110, 255)).all(axis=-1).any()  # cameras
    record = load_scene(dataset, "val_mini", "parametric_house-s1").record
    assert drawn.area_m2 == pytest.approx(sum(f.area_m2 for f in record.floors), rel=0.15)
    assert 0.2 * drawn.area_m2 < drawn.seen_m2 < 0.9 * drawn.area_m2
    with pytest.raises(ConfigError, match="no scene"):
        draw(dataset, "val_mini", "castle-s1", tmp_path)


def test_the_folder_that_is_used_unasked_is_named_by_the_edition():
    assert DEFAULT_ROOT.name == f"surveilnav-{EDITION}"
