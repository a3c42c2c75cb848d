"""A dataset comes out the same, resumes, and its faults are named."""

from __future__ import annotations

import gzip
import json
import shutil

import pytest

from benchmark.dataset.check import check
from benchmark.dataset.load import load_scene
from benchmark.dataset.make import make, write_manifest
from benchmark.dataset.show import draw
from benchmark.dataset.splits import SplitSpec, quotas, splits_of, take
from surveilnav.errors import ConfigError
from tests.benchmark.dataset.conftest import SPLIT


def _bytes(root):
    return {p.relative_to(root).as_posix(): p.read_bytes() for p in sorted(root.rglob("*.json*"))}


def test_built_twice_it_is_the_same(dataset, tmp_path):
    make(tmp_path, [SPLIT], workers=2)
    assert _bytes(tmp_path) == _bytes(dataset)


def test_only_what_is_missing_is_built(dataset, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    (root / "val_mini" / "scenes" / "parametric_flat-s0.json").unlink()  # as a kill leaves it
    built = []
    make(root, [SPLIT], workers=1, on_progress=lambda done, total, scene: built.append((done, total, scene)))
    assert built == [(1, 1, "parametric_flat-s0")]
    assert _bytes(root) == _bytes(dataset)


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
def test_what_is_damaged_is_built_anew(dataset, tmp_path, spoil):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    spoil(root / "val_mini")
    assert any("parametric_flat-s0" in f.where for f in check(root, deep=False))
    make(root, [SPLIT], workers=1)
    assert _bytes(root) == _bytes(dataset)


def test_what_was_changed_in_another_split_gets_no_new_hash(dataset, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    shutil.copytree(root / "val_mini", root / "val")
    (root / "val" / "val_mini.json.gz").rename(root / "val" / "val.json.gz")
    write_manifest(root)
    before = (root / "dataset.json").read_bytes()
    _edit(root / "val" / "content" / "parametric_flat-s0.json.gz", _start_elsewhere)
    with pytest.raises(ConfigError, match=r"val/content/parametric_flat-s0.json.gz .* build val as well"):
        make(root, [SPLIT], workers=1)
    assert (root / "dataset.json").read_bytes() == before


def _flip(path):
    """Spoils the packed data itself, not its length or its header."""
    data = bytearray(path.read_bytes())
    for at in range(60, 80):
        data[at] ^= 0xFF
    path.write_bytes(data)


def test_a_dataset_of_another_version_is_kept_unless_asked(dataset, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    manifest = json.loads((root / "dataset.json").read_text())
    (root / "dataset.json").write_text(json.dumps(manifest | {"version": 1}))
    before = _bytes(root)
    with pytest.raises(ConfigError, match=r"version 1.*--anew"):
        make(root, [SPLIT], workers=1)
    assert _bytes(root) == before
    make(root, [SPLIT], workers=2, anew=True)
    assert _bytes(root) == _bytes(dataset)


def test_a_split_that_is_half_built_isnt_listed(dataset, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    shutil.copytree(root / "val_mini", root / "val")
    (root / "val" / "val_mini.json.gz").unlink()  # as a build of val that was stopped leaves it: no index
    assert list(write_manifest(root).splits) == ["val_mini"]


def test_a_sound_dataset_has_no_errors(dataset):
    assert [f for f in check(dataset) if f.level == "error"] == []


def test_counts_that_dont_come_out_are_an_error(dataset, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    with pytest.raises(ConfigError, match="should have 4 floors"):
        make(root, [SplitSpec("val_mini", SPLIT.scenes, 9, (4, 3))], workers=1)


def _edit(path, change):
    content = json.loads(gzip.decompress(path.read_bytes()))
    change(content)
    path.write_bytes(gzip.compress(json.dumps(content).encode()))


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


def _goal_that_isnt_there(content):
    next(iter(content["goals_by_category"].values()))[0]["object_id"] = "60000"


@pytest.mark.parametrize(
    ("change", "level", "said"),
    [
        (_start_in_a_wall, "error", "starts where no way leads to a goal"),
        (_no_viewpoint, "error", "no viewpoint: unreachable"),
        (_no_category, "note", "has no toilet"),
        (_goal_that_isnt_there, "error", "with the number 60000"),
        (_no_number, "error", "holds what can't be"),
        (_start_without_place, "error", "holds what can't be"),
    ],
)
def test_faults_are_named(dataset, tmp_path, change, level, said):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
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
        (lambda c, m2: c["cameras"][m2][0].update(position_m=[500.0, 500.0, 100.0]), "sees nothing within 10 m"),
        (lambda c, m2: c["cameras"][m2][0]["views"].pop(), "has 12 views, expected 13"),
        (lambda c, m2: c["view_bytes"].pop(m2), "bytes of 0 views, it has 13"),
        (lambda c, m2: c["cameras"][m2].pop(), "its floors count 1"),
        (lambda c, m2: c["cameras"].pop(m2), "its floors count 1"),
    ],
    ids=["sees nothing", "few views", "not measured", "missing", "no density"],
)
def test_what_is_wrong_with_a_camera_is_named(dataset, tmp_path, m2, change, said):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    _edit(root / "val_mini" / "cameras" / "parametric_flat-s0.json.gz", lambda content: change(content, m2))
    write_manifest(root)
    found = [f for f in check(root) if said in f.what]
    assert [f.level for f in found] == ["error"]
    assert f"{m2} m2" in found[0].what


def test_a_building_that_comes_out_otherwise_is_named(dataset, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    path = root / "val_mini" / "scenes" / "parametric_flat-s0.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | {"content_hash": "0" * 64}))
    write_manifest(root)
    assert any("another version of the program" in f.what for f in check(root))


def test_a_damaged_file_is_named(dataset, tmp_path):
    root = tmp_path / "copy"
    shutil.copytree(dataset, root)
    path = root / "val_mini" / "content" / "parametric_flat-s0.json.gz"
    path.write_bytes(path.read_bytes()[:200])
    assert any("can't be read" in f.what and "parametric_flat-s0" in f.what for f in check(root, deep=False))


def test_quotas_and_categories_are_even():
    assert quotas(1000, 36) == [28] * 28 + [27] * 8
    assert take({"a": 5, "b": 1, "c": 5}, 7) == {"a": 3, "b": 1, "c": 3}
    assert take({"a": 1, "b": 1}, 7) == {"a": 1, "b": 1}
    assert take({"a": 5, "b": 5}, 3, first=1) == {"a": 1, "b": 2}


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
