from __future__ import annotations

import hashlib
import io
import subprocess
import tarfile
import threading
from pathlib import Path

import pytest
import zstandard

from surveilnav.errors import AssetError
from surveilnav.simulator.furniture import assets
from surveilnav.simulator.furniture.assets import ensure_assets, is_complete, unpack_deb
from surveilnav.simulator.furniture.catalog import JAR, LIBRARIES

FILES = {
    f"./{JAR}": b"the jar",
    f"./{LIBRARIES}/Scopia.sh3f": b"a library",
    "./usr/share/doc/sweethome3d/copyright": b"credits",
    "./usr/bin/evil": b"not wanted",
    "./../../etc/evil": b"not wanted",
}


def deb(path: Path, files: dict[str, bytes], kind: str = "xz") -> Path:
    """A Debian package with those files, as deb(5) has it."""
    raw = io.BytesIO()
    with tarfile.open(fileobj=raw, mode="w" if kind == "zst" else f"w:{kind}") as tar:
        for name, data in files.items():
            info = tarfile.TarInfo(name)
            info.size = len(data)
            tar.addfile(info, io.BytesIO(data))
        link = tarfile.TarInfo(f"./{LIBRARIES}/link.sh3f")
        link.type, link.linkname = tarfile.SYMTYPE, "/etc/passwd"
        tar.addfile(link)
    data = zstandard.compress(raw.getvalue()) if kind == "zst" else raw.getvalue()
    members = (("debian-binary", b"2.0\n"), ("control.tar.xz", b"odd"), (f"data.tar.{kind}", data))
    with path.open("wb") as file:
        file.write(b"!<arch>\n")
        for name, content in members:
            file.write(f"{name:<16}{0:<12}{0:<6}{0:<6}{'100644':<8}{len(content):<10}`\n".encode() + content)
            file.write(b"\n" * (len(content) % 2))
    return path


@pytest.mark.parametrize("kind", ["xz", "gz", "zst"])
def test_only_what_is_wanted_is_unpacked(tmp_path: Path, kind: str) -> None:
    unpack_deb(deb(tmp_path / "a.deb", FILES, kind), tmp_path / "root")
    found = {str(p.relative_to(tmp_path / "root")) for p in (tmp_path / "root").rglob("*") if not p.is_dir()}
    assert found == {JAR, f"{LIBRARIES}/Scopia.sh3f", "usr/share/doc/sweethome3d/copyright"}
    assert (tmp_path / "root" / JAR).read_bytes() == b"the jar"


@pytest.mark.parametrize("cut", [0, 8, 40, 100, 250])
def test_a_damaged_package_is_named(tmp_path: Path, cut: int) -> None:
    path = deb(tmp_path / "a.deb", FILES)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(AssetError, match=r"a\.deb is damaged"):
        unpack_deb(path, tmp_path / "root")


class Apt:
    """Stands in for apt: its index, and what a download leaves behind."""

    def __init__(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.downloads = 0
        self.content = deb(tmp_path / "made.deb", FILES).read_bytes()
        self.index = hashlib.sha256(self.content).hexdigest()
        self.fails = ""
        monkeypatch.setattr(assets.shutil, "which", lambda name: f"/usr/bin/{name}")
        monkeypatch.setattr(assets.subprocess, "run", self.run)

    def run(self, command: list[str], cwd: Path | None = None, **_: object) -> subprocess.CompletedProcess[str]:
        if command[0] == "apt-cache":
            return subprocess.CompletedProcess(
                command, 0, f"Package: x\nSHA256: {self.index}\n" if self.index else "", ""
            )
        if self.fails:
            return subprocess.CompletedProcess(command, 100, "", self.fails)
        assert cwd is not None
        self.downloads += 1
        (cwd / f"{command[-1]}_1_all.deb").write_bytes(self.content)
        return subprocess.CompletedProcess(command, 0, "", "")


@pytest.fixture
def apt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Apt:
    return Apt(tmp_path, monkeypatch)


def test_fetched_once_even_by_many_at_once(tmp_path: Path, apt: Apt) -> None:
    said: list[str] = []
    results: list[Path] = []
    threads = [
        threading.Thread(target=lambda: results.append(ensure_assets(said.append, cache=tmp_path))) for _ in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [tmp_path / "assets" / "sweethome3d"] * 4
    assert is_complete(results[0])
    assert apt.downloads == 2
    assert any("downloading" in words for words in said)
    assert {p.name for p in (tmp_path / "assets").iterdir()} == {".lock", "sweethome3d"}  # nothing half-done is left


def test_an_interrupted_unpacking_is_done_again(tmp_path: Path, apt: Apt) -> None:
    half = tmp_path / "assets" / "sweethome3d" / JAR
    half.parent.mkdir(parents=True)
    half.write_bytes(b"half")
    assert is_complete(ensure_assets(cache=tmp_path))
    assert half.read_bytes() == b"the jar"
    assert apt.downloads == 2


def test_a_package_that_apts_index_does_not_name_is_refused(tmp_path: Path, apt: Apt) -> None:
    apt.index = "0" * 64
    with pytest.raises(AssetError, match="expected SHA-256"):
        ensure_assets(cache=tmp_path)
    assert not (tmp_path / "assets" / "sweethome3d").exists()


def test_packages_put_there_by_hand_are_taken(tmp_path: Path, apt: Apt) -> None:
    (tmp_path / "assets").mkdir()
    for package in assets.PACKAGES:
        (tmp_path / "assets" / f"{package}_9_all.deb").write_bytes(apt.content)
    assert is_complete(ensure_assets(cache=tmp_path))
    assert apt.downloads == 0


def test_what_to_do_is_said(tmp_path: Path, apt: Apt, monkeypatch: pytest.MonkeyPatch) -> None:
    apt.fails = "Could not resolve"
    with pytest.raises(AssetError, match=r"Could not resolve.*apt-get update.*parametric_flat"):
        ensure_assets(cache=tmp_path)
    apt.index = ""
    with pytest.raises(AssetError, match=r"knows no package.*apt-get update.*universe"):
        ensure_assets(cache=tmp_path)
    monkeypatch.setattr(assets.shutil, "which", lambda _: None)
    with pytest.raises(AssetError, match=r"no apt-get here.*put both .deb files into.*parametric_flat"):
        ensure_assets(cache=tmp_path)


def test_a_package_without_furniture_is_no_use(tmp_path: Path, apt: Apt) -> None:
    apt.content = deb(tmp_path / "empty.deb", {f"./{JAR}": b"the jar"}).read_bytes()
    apt.index = hashlib.sha256(apt.content).hexdigest()
    with pytest.raises(AssetError, match="lack"):
        ensure_assets(cache=tmp_path)


def test_a_cache_that_cannot_be_written_is_named(tmp_path: Path, apt: Apt) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(AssetError, match="SURVEILNAV_CACHE_DIR"):
        ensure_assets(cache=tmp_path / "file")
    assert apt.downloads == 0
