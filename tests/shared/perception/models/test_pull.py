"""Downloads: resumed, checked, refused; and what stops them."""

from __future__ import annotations

import errno
import json
import shutil
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from surveilnav.errors import PerceptionError
from surveilnav.perception import models
from surveilnav.perception.models import hashes, transfer
from surveilnav.perception.models.catalogue import File, Model

DATA = bytes(range(256)) * 20


def test_a_download_is_checked_kept_and_used_again(machine, one_file):
    assert models.find("fake").read_bytes() == DATA
    assert models.find("fake").read_bytes() == DATA
    assert len(one_file.asked) == 1
    assert one_file.asked[0][1]["accept-encoding"] == "identity"
    assert not list(machine.glob("*.part*"))


def test_who_wants_the_same_at_the_same_time_waits(one_file):
    with ThreadPoolExecutor(4) as pool:
        assert len({str(path) for path in pool.map(models.find, ["fake"] * 4)}) == 1
    assert len(one_file.asked) == 1


def test_models_pulled_at_once_keep_each_others_hashes(machine, monkeypatch):
    read_lock = hashes.read_lock

    def read_slowly(folder):
        seen = read_lock(folder)
        time.sleep(0.02)
        return seen

    monkeypatch.setattr(hashes, "read_lock", read_slowly)
    pulled = [
        Model(name=f"m{i}", kind="detector", family="yolox", licence="none", files=(File("m.onnx"),), url=f"x{i}")
        for i in range(8)
    ]
    with ThreadPoolExecutor(8) as pool:
        list(
            pool.map(
                lambda model: hashes.write_lock_entry(model, machine, hashes.LockEntry(model.source, "", {"m": "0"})),
                pulled,
            )
        )
    assert set(read_lock(machine)) == {model.name for model in pulled}


def test_progress_is_told(one_file):
    told = []
    models.pull("fake", on_progress=lambda *said: told.append(said))
    assert told[-1] == (len(DATA), len(DATA), "fake.onnx")


def test_a_broken_transfer_goes_on_where_it_was(one_file):
    one_file.cut_at = [2048, 1024]
    assert models.find("fake").read_bytes() == DATA
    assert one_file.ranges_asked == [None, "bytes=2048-", "bytes=3072-"]
    assert [headers.get("if-range") for _, headers in one_file.asked] == [None, '"one"', '"one"']


def test_what_broke_off_in_one_run_goes_on_in_the_next(machine, one_file):
    one_file.cut_at = [2048, 0]
    with pytest.raises(PerceptionError, match=r"goes on from there.*SURVEILNAV_MODELS_DIR"):
        models.find("fake")
    assert not (machine / "fake.onnx").exists(), "half a file has no name"
    assert (machine / "fake.onnx.part").stat().st_size == 2048
    assert models.find("fake").read_bytes() == DATA
    assert one_file.ranges_asked[-1] == "bytes=2048-"


def test_a_server_without_ranges_sends_all_of_it_again(one_file):
    one_file.cut_at, one_file.ranges = [2048], False
    assert models.find("fake").read_bytes() == DATA


def test_a_file_that_changed_in_between_is_begun_anew(machine, of_the_hub):
    of_the_hub.cut_at = [5, 0]
    with pytest.raises(PerceptionError):
        models.pull("hubbed")
    of_the_hub.etag = '"two"'
    for revision in ("main", "c0ffee"):
        of_the_hub.files[f"/some/one/resolve/{revision}/config.json"] = b'{"model_type": "siglip"}'
    path = models.pull("hubbed")
    assert (path / "config.json").read_bytes() == b'{"model_type": "siglip"}'


def test_a_whole_part_needs_no_request(machine, one_file):
    machine.mkdir(parents=True)
    (machine / "fake.onnx.part").write_bytes(DATA)
    assert models.find("fake").read_bytes() == DATA
    assert one_file.asked == []


def test_a_whole_part_of_unknown_length_is_taken(machine, of_the_hub):
    (machine / "hubbed").mkdir(parents=True)
    (machine / "hubbed" / "vocab.txt.part").write_bytes(b"a\nb\n")
    (machine / "hubbed" / "vocab.txt.part.etag").write_text('"one"')
    assert (models.pull("hubbed") / "vocab.txt").read_bytes() == b"a\nb\n"
    assert [r for r in of_the_hub.ranges_asked if r] == ["bytes=4-"]


@pytest.mark.parametrize("length", [5120, 100, 100_000])
def test_another_file_than_expected_is_not_used(length, machine, one_file):
    one_file.files["/fake.onnx"] = b"x" * length
    with pytest.raises(PerceptionError, match=r"another file than expected.*SURVEILNAV_MODELS_DIR"):
        models.find("fake")
    assert not list(machine.glob("fake*"))


def test_a_size_is_held_to_where_no_hash_is_known(one_file, monkeypatch):
    of_unknown_hash = Model(
        name="sized",
        kind="detector",
        family="yolox",
        licence="none",
        url=f"{one_file.address}/fake.onnx",
        files=(File("sized.onnx", len(DATA) + 1),),
    )
    monkeypatch.setitem(models.CATALOGUE, "sized", of_unknown_hash)
    with pytest.raises(PerceptionError, match=r"5,120 bytes .* not 5,121"):
        models.find("sized")


def test_a_part_of_another_file_is_thrown_away(machine, one_file):
    machine.mkdir(parents=True)
    (machine / "fake.onnx.part").write_bytes(b"y" * 100)
    with pytest.raises(PerceptionError, match="another file"):
        models.find("fake")
    assert models.find("fake").read_bytes() == DATA


def test_a_file_whose_length_nobody_knows_is_refused(machine, of_the_hub):
    of_the_hub.says_length = False
    with pytest.raises(PerceptionError, match="how long"):
        models.pull("hubbed")


@pytest.mark.parametrize(("status", "said"), [(503, "HTTP 503"), (404, r"404.*needs config.json")])
def test_a_server_that_has_nothing_is_named(status, said, of_the_hub):
    of_the_hub.status = status
    with pytest.raises(PerceptionError, match=said):
        models.pull("hubbed")


@pytest.mark.parametrize("address", ["nowhere", "http://[", "http://127.0.0.1:1"])
def test_an_address_that_cannot_be_is_said(address, of_the_hub, monkeypatch):
    monkeypatch.setenv("HF_ENDPOINT", address)
    with pytest.raises(PerceptionError, match="can't be downloaded"):
        models.pull("hubbed")


# --- the hub ------------------------------------------------------------------------------------------------------


def test_a_folder_is_pulled_file_by_file_of_one_commit(machine, of_the_hub):
    path = models.find("hubbed")
    assert path == machine / "hubbed"
    assert [asked.split("/")[4] for asked, _ in of_the_hub.asked] == ["main", *["c0ffee"] * 4]
    assert not (path / "merges.txt").exists(), "optional, and the hub has none"
    assert models.find("hubbed") == path
    assert len(of_the_hub.asked) == 5


def test_the_first_pull_is_trusted_and_later_content_held_to_it(machine, of_the_hub):
    path = models.pull("hubbed")
    locked = json.loads((machine / "models.lock.json").read_text())["hubbed"]
    assert locked["source"] == "some/one@main"
    assert locked["revision"] == "c0ffee"
    assert set(locked["sha256"]) == {"config.json", "preprocessor_config.json", "vocab.txt", "model.safetensors"}
    (path / "vocab.txt").unlink()
    of_the_hub.files["/some/one/resolve/c0ffee/vocab.txt"] = b"c\nd\n"
    with pytest.raises(PerceptionError, match="another file"):
        models.pull("hubbed")
    (path / "vocab.txt").write_bytes(b"e\nf\n")
    with pytest.raises(PerceptionError, match=r"vocab.txt isn't what hubbed should be.*path"):
        models.find("hubbed")


def test_a_lock_of_another_source_counts_for_nothing(machine, of_the_hub, monkeypatch):
    machine.mkdir(parents=True)
    old = {"hubbed": {"source": "some/one@older", "revision": "0ld", "sha256": {"vocab.txt": "0" * 64}}}
    (machine / "models.lock.json").write_text(json.dumps(old))
    models.pull("hubbed")
    assert json.loads((machine / "models.lock.json").read_text())["hubbed"]["revision"] == "c0ffee"


def test_a_damaged_lock_is_named(machine, of_the_hub):
    machine.mkdir(parents=True)
    (machine / "models.lock.json").write_text("{")
    with pytest.raises(PerceptionError, match=r"models.lock.json.*Remove it"):
        models.pull("hubbed")


def test_the_hubs_own_hash_is_asked_of_what_comes(of_the_hub):
    of_the_hub.headers["X-Linked-ETag"] = f'"{"0" * 64}"'
    with pytest.raises(PerceptionError, match=r"another file than expected.*000000000000"):
        models.pull("hubbed")


def test_a_pull_between_two_files_goes_on(machine, of_the_hub):
    vocab = {path: data for path, data in of_the_hub.files.items() if path.endswith("vocab.txt")}
    for path in vocab:
        del of_the_hub.files[path]
    with pytest.raises(PerceptionError, match=r"needs vocab.txt"):
        models.find("hubbed")
    with pytest.raises(
        PerceptionError, match=r"half of hubbed.*vocab.txt, model.safetensors missing.*models pull hubbed"
    ):
        models.find("hubbed", download=False)
    of_the_hub.files |= vocab
    of_the_hub.asked.clear()
    models.find("hubbed")
    assert [path.rsplit("/", 1)[1] for path, _ in of_the_hub.asked] == ["vocab.txt", "model.safetensors", "merges.txt"]


def test_a_folder_can_be_told(of_the_hub, machine, tmp_path, monkeypatch):
    path = models.pull("hubbed", to=tmp_path / "stick")
    assert path == tmp_path / "stick" / "hubbed"
    assert not machine.joinpath("hubbed").exists()
    monkeypatch.setenv("SURVEILNAV_MODELS_DIR", str(tmp_path / "stick"))
    assert models.find("hubbed", download=False) == path


# --- what stops a pull --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("variable", ["SURVEILNAV_OFFLINE", "HF_HUB_OFFLINE"])
def test_offline_opens_no_socket(variable, one_file, monkeypatch):
    opened = []
    monkeypatch.setattr(socket.socket, "connect", lambda *a: opened.append(a))
    monkeypatch.setenv(variable, "1")
    for fetch in (models.find, models.pull):
        with pytest.raises(PerceptionError, match=rf"{variable}.*SURVEILNAV_MODELS_DIR"):
            fetch("fake")
    assert opened == []
    assert one_file.asked == []


@pytest.mark.parametrize("value", ["0", "false", ""])
def test_offline_can_be_said_to_be_off(value, one_file, monkeypatch):
    monkeypatch.setenv("HF_HUB_OFFLINE", value)
    assert models.find("fake").read_bytes() == DATA


def test_no_room_is_said_before_the_first_byte(machine, one_file, monkeypatch):
    monkeypatch.setattr(transfer.shutil, "disk_usage", lambda _: shutil._ntuple_diskusage(10, 10, 1000))
    with pytest.raises(PerceptionError, match=r"no room for fake.onnx.*SURVEILNAV_CACHE_DIR"):
        models.find("fake")
    assert not list(machine.glob("fake*"))


@pytest.mark.parametrize(
    ("number", "said"), [(errno.ENOSPC, r"no room.*goes on"), (errno.EROFS, r"can't be written.*SURVEILNAV_CACHE_DIR")]
)
def test_a_disk_that_takes_nothing_is_named(number, said, one_file, monkeypatch):
    plain = Path.open

    def refuse(self, mode="r", *rest, **more):
        if self.suffix == ".part" and "a" in mode:
            raise OSError(number, "no", str(self))
        return plain(self, mode, *rest, **more)

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(PerceptionError, match=said):
        models.find("fake")


def test_a_cache_that_cannot_be_written_is_named(machine, one_file):
    machine.parent.mkdir()
    machine.write_text("a file where the folder should be")
    with pytest.raises(PerceptionError, match=r"can't be pulled.*SURVEILNAV_CACHE_DIR"):
        models.find("fake")


def test_what_was_fetched_is_not_hashed_twice(one_file, monkeypatch):
    path = models.pull("fake")
    monkeypatch.setattr(hashes.hashlib, "file_digest", None)
    assert hashes.sha256(path)
