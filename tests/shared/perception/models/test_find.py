"""Where models are found, what is refused of what lies there, and which weights an embedding names."""

from __future__ import annotations

import io
import json
import zipfile

import msgspec
import pytest

from surveilnav.errors import PerceptionError
from surveilnav.perception import models
from surveilnav.perception.models import hashes

WEIGHTS = "model__safetensors"
OLD_TORCH = b"\x80\x02\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."  # how torch.save began before 1.6


@pytest.fixture
def given(machine, tmp_path, monkeypatch):
    """A folder of models, named by SURVEILNAV_MODELS_DIR."""
    folder = tmp_path / "given"
    folder.mkdir()
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(folder))
    return folder


def test_the_given_folder_comes_before_the_cache(given, of_the_hub, folder_at):
    in_cache = models.pull("hubbed")
    assert models.find("hubbed") == in_cache
    folder_at(given / "hubbed")
    assert models.find("hubbed") == given / "hubbed"


def test_what_is_not_here_is_named_with_the_way_to_get_it(machine, of_the_hub):
    with pytest.raises(PerceptionError, match=r"hubbed isn't on this machine.*surveilnav models pull hubbed"):
        models.find("hubbed", download=False)
    with pytest.raises(PerceptionError, match=r"expected a model out of .*clip-vit-b32.*'hubbedd'"):
        models.find("hubbedd")
    assert of_the_hub.asked == []


@pytest.mark.parametrize(("about_mb", "asked"), [(100, True), (101, False)])
def test_only_small_models_are_fetched_unasked(about_mb, asked, machine, of_the_hub, monkeypatch):
    large = msgspec.structs.replace(models.CATALOGUE["hubbed"], about_mb=about_mb)
    monkeypatch.setitem(models.CATALOGUE, "hubbed", large)
    if asked:
        assert models.find("hubbed").is_dir()
    else:
        with pytest.raises(PerceptionError, match=r"101 MB, .* up to 100 MB .*`surveilnav models pull hubbed`"):
            models.find("hubbed")
        models.pull("hubbed")
        (machine / "hubbed" / "vocab.txt").unlink()
        n = len(of_the_hub.asked)
        with pytest.raises(PerceptionError, match=r"half of hubbed"):
            models.find("hubbed")
        assert len(of_the_hub.asked) == n, "a pull that broke off isn't gone on with unasked either"


def test_a_wrong_file_is_refused(given):
    (given / "yolox_nano.onnx").write_bytes(b"not a network")
    with pytest.raises(PerceptionError, match=r"isn't what yolox-nano should be: its sha256 begins"):
        models.find("yolox-nano")


def test_a_custom_file_is_named_by_its_setting(machine, tmp_path, monkeypatch, network):
    with pytest.raises(PerceptionError, match="SURVEILNAV_YOLO_WORLD"):
        models.find("yolo-world")
    with pytest.raises(PerceptionError, match="no public address"):
        models.pull("yolo-world")
    (tmp_path / "mine.onnx").write_bytes(network)
    monkeypatch.setenv("SURVEILNAV_YOLO_WORLD", str(tmp_path / "mine.onnx"))
    assert models.find("yolo-world") == tmp_path / "mine.onnx"
    assert models.family("yolo-world") == "yolo-world"
    monkeypatch.setenv("SURVEILNAV_YOLO_WORLD", str(tmp_path / "gone.onnx"))
    with pytest.raises(PerceptionError, match="yolo-world"):
        models.find("yolo-world")


def archive():
    """As PyTorch saves: a zip."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as out:
        out.writestr("archive/data.pkl", b"tensors" * 100)
    return file.getvalue()


def test_a_custom_file_that_is_no_network_is_refused(machine, tmp_path, monkeypatch, network):
    for name, data, said in (
        ("passwd", b"root:x:0:0", r"expected yolo-world as a file .onnx, and .*passwd"),
        ("words.onnx", b"root:x:0:0", r"words.onnx can't be loaded as an ONNX network"),
        ("half.onnx", network[:-20], r"half.onnx can't be loaded as an ONNX network"),
        ("mine.pt", archive(), r"expected yolo-world as a file .onnx"),
    ):
        (tmp_path / name).write_bytes(data)
        monkeypatch.setenv("SURVEILNAV_YOLO_WORLD", str(tmp_path / name))
        with pytest.raises(PerceptionError, match=said):
            models.find("yolo-world")
        assert models.survey("yolo-world").fault


@pytest.mark.parametrize(
    ("data", "is_taken"),
    [(archive(), True), (OLD_TORCH + b"more", True), (archive()[:-10], False), (b"root:x:0:0", False)],
)
def test_weights_of_pytorch_are_told_from_others_and_from_half_of_them(data, is_taken, machine, tmp_path, folder_at):
    (own := tmp_path / "mine.pt").write_bytes(data)
    folder = folder_at(tmp_path / "folder", model__safetensors=None, pytorch_model__bin=data)
    for path in (own, folder):
        if is_taken:
            assert models.find(str(path)) == path
        else:
            with pytest.raises(PerceptionError, match=r"isn't what PyTorch saves, or isn't whole"):
                models.find(str(path))


# --- folders ------------------------------------------------------------------------------------------------------


def test_a_folder_goes_by_its_path(machine, tmp_path, folder_at):
    folder = folder_at(tmp_path / "mine")
    assert models.find(str(folder)) == folder
    assert models.family(str(folder)) == "clip"


def test_a_folder_of_any_name_is_found_in_the_given_one(given, folder_at):
    folder_at(given / "mine", config__json=b'{"model_type": "owlv2"}')
    assert models.find("mine") == given / "mine"
    assert models.family("mine") == "owlv2"


@pytest.mark.parametrize(
    ("other", "said"),
    [
        ({"config__json": None}, r"config.json, there is nothing"),
        ({"config__json": b"{}"}, "no model_type"),
        ({"config__json": b"{"}, r"config.json should be .* JSON"),
        ({WEIGHTS: None}, "no weights"),
        ({WEIGHTS: b""}, "is empty"),
        ({WEIGHTS: b"half"}, "no safetensors file"),
        ({"preprocessor_config__json": b"{"}, "is damaged"),
    ],
)
def test_a_folder_that_is_no_model_is_refused(other, said, machine, tmp_path, folder_at):
    folder = folder_at(tmp_path / "mine", **other)
    with pytest.raises(PerceptionError, match=said):
        models.find(str(folder))


@pytest.mark.parametrize("left", [5, 60, 500])
def test_half_a_file_of_weights_is_refused_though_nobody_knows_its_hash(left, machine, tmp_path, folder_at):
    folder = folder_at(tmp_path / "mine")
    whole = (folder / "model.safetensors").read_bytes()
    (folder / "model.safetensors").write_bytes(whole[:left])
    with pytest.raises(PerceptionError, match=r"model.safetensors (is|isn't) (whole|damaged|no safetensors)"):
        models.find(str(folder))


def test_a_file_by_its_path(machine, tmp_path, network):
    (tmp_path / "mine").write_text("")
    with pytest.raises(PerceptionError, match="is neither"):
        models.find(str(tmp_path / "mine"))
    (own := tmp_path / "mine.onnx").write_bytes(b"")
    with pytest.raises(PerceptionError, match="is empty"):
        models.find(str(own))
    own.write_bytes(network)
    assert models.find(str(own)) == own
    assert models.family(str(own)) == "yolo-world"
    assert models.model_id(str(own), own).startswith("mine.onnx@")


def test_mobile_sam_may_be_two_files_in_a_folder_of_its_name(machine, given, network):
    folder = given / "mobile-sam"
    folder.mkdir()
    (folder / "encoder.onnx").write_bytes(network)
    with pytest.raises(PerceptionError, match=r"config.json"):
        models.find("mobile-sam")
    (folder / "decoder.onnx").write_bytes(network)
    assert models.find("mobile-sam") == folder
    assert models.family("mobile-sam") == "mobile-sam"


def test_weights_in_another_format_do(given, of_the_hub, folder_at):
    folder_at(given / "hubbed", model__safetensors=None, pytorch_model__bin=archive())
    assert models.find("hubbed") == given / "hubbed"


def test_half_a_folder_of_the_users_is_refused_not_filled(given, of_the_hub, folder_at):
    folder_at(given / "hubbed", vocab__txt=None)
    with pytest.raises(PerceptionError, match=r"half of hubbed: vocab.txt missing"):
        models.find("hubbed")
    assert of_the_hub.asked == []


# --- links --------------------------------------------------------------------------------------------------------


def test_links_are_followed(given, of_the_hub, folder_at, tmp_path):
    (given / "hubbed").symlink_to(folder_at(tmp_path / "elsewhere"))
    assert models.find("hubbed") == given / "hubbed"


def test_links_that_lead_nowhere_or_in_a_circle_are_named(given):
    link = given / "yolox_nano.onnx"
    link.symlink_to(given / "gone")
    with pytest.raises(PerceptionError, match="leads nowhere"):
        models.find("yolox-nano")
    link.unlink()
    link.symlink_to(link)
    with pytest.raises(PerceptionError, match="can't be reached"):
        models.find("yolox-nano")


# --- ids ----------------------------------------------------------------------------------------------------------


def test_an_id_names_the_weights(machine, tmp_path, folder_at):
    one, same = folder_at(tmp_path / "a" / "mine"), folder_at(tmp_path / "b" / "mine", vocab__txt=b"other")
    other = folder_at(tmp_path / "c" / "mine", pytorch_model__bin=b"not read: safetensors come first")
    (other / "model.safetensors").write_bytes((other / "model.safetensors").read_bytes() + b"!")
    ids = [models.model_id(str(path), path) for path in (one, same, other)]
    assert ids[0] == ids[1] != ids[2]
    assert ids[0] == f"mine@{hashes.sha256(one / 'model.safetensors')[:8]}"
    assert models.model_id("clip-vit-b32", one).startswith("clip-vit-b32@")


def test_an_id_of_several_files_depends_on_each(machine, tmp_path, folder_at):
    folder = folder_at(tmp_path / "mine", model__safetensors=None)
    ids = set()
    for second in (b"b", b"c"):
        (folder / "model-00001-of-00002.safetensors").write_bytes(b"a")
        (folder / "model-00002-of-00002.safetensors").write_bytes(second)
        ids.add(models.model_id("mine", folder))
    assert len(ids) == 2


def test_hashes_are_remembered_over_starts_until_the_file_changes(machine, tmp_path, monkeypatch):
    path = tmp_path / "x.onnx"
    path.write_bytes(b"one")
    before = models.model_id("x", path)
    monkeypatch.setattr(hashes, "_known", {})  # another process
    plain = hashes.hashlib.file_digest
    monkeypatch.setattr(hashes.hashlib, "file_digest", None)
    assert models.model_id("x", path) == before
    monkeypatch.setattr(hashes.hashlib, "file_digest", plain)
    path.write_bytes(b"other")
    assert models.model_id("x", path) != before


def test_processes_keep_each_others_hashes(machine, tmp_path, monkeypatch):
    for name in ("x.onnx", "y.onnx"):
        (tmp_path / name).write_bytes(name.encode())
    hashes.sha256(tmp_path / "x.onnx")
    monkeypatch.setattr(hashes, "_known", {"began before x was hashed": (0, 0, "")})  # another process
    hashes.sha256(tmp_path / "y.onnx")
    assert {str(tmp_path / "x.onnx"), str(tmp_path / "y.onnx")} <= set(
        json.loads((machine / "digests.json").read_text())
    )


def test_damaged_memory_of_hashes_costs_nothing_but_time(machine, tmp_path, monkeypatch):
    machine.mkdir(parents=True)
    (machine / "digests.json").write_text("[")
    monkeypatch.setattr(hashes, "_known", {})
    (tmp_path / "x.onnx").write_bytes(b"one")
    assert models.model_id("x", tmp_path / "x.onnx")
    assert json.loads((machine / "digests.json").read_text())


def test_a_change_that_keeps_size_and_time_is_seen_by_a_look_anew(given, tmp_path, monkeypatch):
    import os

    good = given / "yolox_nano.onnx"
    good.write_bytes(b"x" * 10)
    model = models.CATALOGUE["yolox-nano"]
    monkeypatch.setitem(models.CATALOGUE, "yolox-nano", _with_hash(model, hashes.sha256(good)))
    times = good.stat()
    good.write_bytes(b"y" * 10)
    os.utime(good, ns=(times.st_atime_ns, times.st_mtime_ns))
    assert models.survey("yolox-nano").fault == ""
    assert "isn't what yolox-nano" in models.survey("yolox-nano", anew=True).fault


def _with_hash(model, sha256):
    return msgspec.structs.replace(model, files=(msgspec.structs.replace(model.files[0], sha256=sha256),))


def test_a_folder_that_cant_be_read_is_named(given):
    with pytest.raises(PerceptionError, match=f"SURVEILNAV_MODELS_DIR is {given}, which can't be read"):
        models.find("x" * 300, download=False)  # too long for a file's name, so that asking for it is an error
