"""``surveilnav models`` as a user types it."""

from __future__ import annotations

import hashlib
import json

import msgspec
import pytest

from surveilnav.cli.doctor import examine
from surveilnav.cli.main import main
from surveilnav.perception import models
from tests.compact_file import write


@pytest.fixture
def folder(monkeypatch, tmp_path):
    """A folder of models, and nothing else that the environment says."""
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("SURVEILNAV_OFFLINE", "1")
    monkeypatch.setenv("COLUMNS", "200")
    given = tmp_path / "given"
    given.mkdir()
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(given))
    return given


@pytest.fixture
def built_in(folder, monkeypatch, tmp_path):
    """Where the package has its own models: nowhere yet."""
    monkeypatch.delenv("SURVEILNAV_COMPACT", raising=False)
    monkeypatch.setattr("surveilnav.perception.models.catalogue.BUILT_IN", tmp_path / "built-in")
    return tmp_path / "built-in"


@pytest.fixture
def typed(folder, monkeypatch, capsys):
    """``typed(*arguments)``: exit status, stdout, stderr of `surveilnav models ...`."""
    monkeypatch.setattr("surveilnav.cli.main.signal.signal", lambda *_: None)

    def run(*arguments):
        monkeypatch.setattr("sys.argv", ["surveilnav", "models", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            main()
        out, err = capsys.readouterr()
        assert "Traceback" not in err
        return ended.value.code, out, err

    return run


def test_list_says_what_there_is_and_what_is_here(typed, folder):
    (folder / "yolox_nano.onnx").write_bytes(b"damaged")
    status, out, _ = typed("list", "--json")
    rows = {row["name"]: row for row in json.loads(out)["items"]}
    assert status == 0
    assert rows["clip-vit-b32"]["licence"].startswith("MIT")
    assert (rows["owlv2-base"]["hash"], rows["clip-vit-h14"]["hash"], rows["yolo-world"]["hash"]) == (
        "known",
        "first pull",
        "none",
    )
    assert "isn't what yolox-nano should be" in rows["yolox-nano"]["fault"]
    assert rows["picodet-s"]["path"] == ""
    status, out, err = typed("list")
    assert (status, err) == (0, "")
    assert "siglip2-base" in out
    assert "models.lock.json" in out


def test_check_fails_for_what_is_wrong_or_named_and_missing(typed, folder):
    assert typed("check")[0] == 0
    status, out, _ = typed("check", "picodet-s", "--json")
    assert status == 1
    assert "models pull picodet-s" in json.loads(out)["picodet-s"]["fault"]
    status, _, err = typed("check", folder / "mine")
    assert (status, "there is nothing" in err) == (1, True)
    (folder / "yolox_nano.onnx").write_bytes(b"damaged")
    status, _, err = typed("check")
    assert status == 1
    assert "wrong yolox-nano" in err


def test_pull_names_a_mistake_in_a_line(typed):
    for arguments, said in ((["clip"], "expected a model out of"), (["clip-vit-b32"], "SURVEILNAV_OFFLINE")):
        status, _, err = typed("pull", *arguments)
        assert status == 1
        assert said in err


def test_the_doctor_knows_the_models(folder, monkeypatch):
    def says():
        return next(finding for finding in examine() if finding.what == "models")

    assert (says().level, "SURVEILNAV_OFFLINE" in says().detail) == ("note", True)
    monkeypatch.delenv("SURVEILNAV_OFFLINE")
    assert str(folder) in says().detail
    (folder / "yolox_nano.onnx").write_bytes(b"damaged")
    assert (says().level, says().remedy) == ("problem", "surveilnav models check")


def test_whole_models_are_listed_checked_and_kept(typed, folder, models_dir, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(models_dir))
    status, out, _ = typed("check", "yolox-nano", "--json")
    assert (status, json.loads(out)) == (0, {"yolox-nano": {"ok": True, "fault": "", "id": "yolox-nano@695e750a"}})


def test_the_model_in_the_package_is_checked_against_its_card(typed, folder, built_in):
    def doctor():
        return next(finding for finding in examine() if finding.what == "compact")

    assert doctor().level == "note"
    assert typed("check")[0] == 0
    weights = write(built_in / "compact" / "compact.onnx")
    digest = hashlib.sha256(weights.read_bytes()).hexdigest()
    assert (doctor().level, f"compact@{digest[:8]}" in doctor().detail) == ("ok", True)
    listed = {row["name"]: row for row in json.loads(typed("list", "--json")[1])["items"]}
    assert (listed["compact"]["bytes"], listed["compact"]["hash"]) == (weights.stat().st_size, "card")
    status, _, err = typed("check")
    assert (status, f"ok    compact@{digest[:8]}: {weights}" in err) == (0, True)
    card = weights.with_name("card.json")
    card.write_bytes(msgspec.json.encode(models.Card(sha256=digest, bytes=1)))
    assert typed("check", "compact")[0] == 0
    card.write_bytes(msgspec.json.encode(models.Card(sha256="0" * 64, bytes=1)))
    status, out, _ = typed("check", "--json")
    assert (status, "isn't what compact should be" in json.loads(out)["compact"]["fault"]) == (1, True)
    assert doctor().level == "problem"
    card.write_text("no card")
    status, _, err = typed("check")
    assert (status, "should be the card of compact.onnx" in err) == (1, True)


def test_offline_the_doctor_says_what_looks_instead(folder, built_in):
    def says():
        return next(finding for finding in examine() if finding.what == "models")

    assert "perception is `simulated`" in says().remedy
    write(built_in / "compact" / "compact.onnx")
    assert "perception is `compact`" in says().remedy
