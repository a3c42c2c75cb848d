"""`surveilnav backup` and `restore`: what is in the file, how it is refused, and that nothing is lost on the way."""

from __future__ import annotations

import io
import json
import os
import sqlite3
import subprocess
import sys
import tarfile
import threading
from pathlib import Path

import pytest

from surveilnav.cli.backup import backup, restore
from surveilnav.cli.backup_archive import open_archive
from surveilnav.cli.backup_stores import StoreCopies, is_in_use, store_files
from surveilnav.errors import ConfigError


def make_store(path: Path, *rows: str) -> sqlite3.Connection:
    """A planner's store as the planner keeps it; it stays open."""
    path.parent.mkdir(parents=True, exist_ok=True)
    db = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("CREATE TABLE IF NOT EXISTS missions (id TEXT PRIMARY KEY, finished INTEGER)")
    for row in rows:
        db.execute("INSERT INTO missions VALUES (?, 0)", (row,))
    return db


def missions_in(path: Path) -> list[str]:
    db = sqlite3.connect(path)
    try:
        return [id for (id,) in db.execute("SELECT id FROM missions ORDER BY rowid")]
    finally:
        db.close()


class Place:
    """A folder with the stores of one building, in the working directory of the test."""

    def __init__(self, folder: Path) -> None:
        self.state, self.looks, self.file = folder / "state", folder / "looks", folder / "saved.backup"
        self.store = self.state / "1f0c" / "planner.sqlite"
        make_store(self.store, "m1").close()
        (self.store.parent / "robot.state").write_bytes(b"here")
        (self.store.parent / "fusion.sqlite.corrupt").write_bytes(b"set aside")
        self.looks.mkdir()
        (self.looks / "looks-1.jsonl").write_text("{}\n")

    def backup(self, **more) -> None:
        backup(self.file, state=self.state, looks=self.looks, **more)

    def restore(self, **more) -> None:
        restore(self.file, state=self.state, looks=self.looks, **more)

    def files(self) -> dict[str, bytes]:
        found = [path for folder in (self.state, self.looks) for path in folder.rglob("*") if path.is_file()]
        return {path.name: path.read_bytes() for path in found if not path.name.endswith(("-wal", "-shm"))}


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


def test_what_was_saved_comes_back(place, tmp_path, capsys):
    recordings, security = tmp_path / "recordings", tmp_path / "security"
    for folder, name in ((recordings, "m1.mcap"), (security, "key.pem")):
        folder.mkdir()
        (folder / name).write_bytes(os.urandom(3_000_000))
    (security / "key.pem").chmod(0o600)
    secret = (security / "key.pem").read_bytes()
    place.backup(recordings=recordings, security=security, as_json=True)
    told = json.loads(capsys.readouterr().out)
    assert place.file.stat().st_mode & 0o777 == 0o600
    assert {row["name"] for row in told["contents"]} == {
        "state/1f0c/planner.sqlite",
        "state/1f0c/robot.state",
        "looks/looks-1.jsonl",
        "recordings/m1.mcap",
        "security/key.pem",
    }
    assert next(row for row in told["contents"] if "planner" in row["name"])["missions_open"] == 1
    assert told["left_out"] == []
    (security / "key.pem").unlink()
    (place.store.parent / "robot.state.halted").write_bytes(b"since then")
    with make_store(place.store, "m2") as db:
        db.execute("INSERT INTO missions VALUES ('m3', 0)")
    db.close()
    place.restore(security=security, force=True)
    assert missions_in(place.store) == ["m1"]
    assert (security / "key.pem").read_bytes() == secret
    assert (security / "key.pem").stat().st_mode & 0o777 == 0o600
    assert (recordings / "m1.mcap").exists()
    assert not (place.store.parent / "robot.state.halted").exists(), "the folder is as it was"
    assert (place.store.parent / "fusion.sqlite.corrupt").exists(), "what was set aside belongs to whoever repairs it"
    assert not list(place.state.glob(".*"))
    said = capsys.readouterr().out
    assert "not restored: recordings" in said


def test_secrets_and_recordings_are_left_out_unless_asked(place, capsys):
    place.backup()
    said = capsys.readouterr().out
    assert "not in it: security" in said
    assert "not in it: recordings" in said
    assert "missions: 1, 1 of them open" in said


def test_a_copy_is_of_one_moment_and_keeps_nobody_from_writing(tmp_path):
    """Rows are written in pairs all the time: whatever the moment, a copy has both of a pair."""
    path, stopping, written = tmp_path / "s.sqlite", threading.Event(), [0]
    make_store(path).close()

    def write() -> None:
        db = make_store(path)
        while not stopping.is_set():
            db.execute("BEGIN")
            for half in ("a", "b"):
                db.execute("INSERT INTO missions VALUES (?, 0)", (f"{half}{written[0]}" + "x" * 5000,))
            db.execute("COMMIT")
            written[0] += 1
        db.close()

    thread = threading.Thread(target=write)
    thread.start()
    try:
        for _ in range(5):
            before, sizes = written[0], []
            copies = StoreCopies([path])
            copies.copy(path, copy := tmp_path / "copy", sizes.append)
            n = len(missions_in(copy))
            assert n % 2 == 0
            assert n >= 2 * before
            assert sum(sizes) == copy.stat().st_size
            while written[0] < before + 5:  # also before the copies are closed
                assert thread.is_alive()
            copies.close()
            copy.unlink()
    finally:
        stopping.set()
        thread.join()


def test_nothing_is_overwritten_unasked(place):
    place.backup()
    with pytest.raises(ConfigError, match=r"exists already.*--force"):
        place.backup()
    before = place.files()
    with pytest.raises(ConfigError, match=r"has stores already.*--force"):
        place.restore()
    assert place.files() == before
    place.backup(force=True)


def test_stores_that_a_service_uses_are_not_replaced(place):
    place.backup()
    program = f"""
import sqlite3, sys
db = sqlite3.connect({str(place.store)!r}, isolation_level=None)
db.execute("SELECT * FROM missions").fetchall()
print("open", flush=True)
sys.stdin.read()
"""
    service = subprocess.Popen([sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert service.stdout.readline() == b"open\n"
    try:
        assert is_in_use(place.store)
        with pytest.raises(ConfigError, match=r"a service is using .*planner.sqlite: stop the system first"):
            place.restore(force=True)
        assert missions_in(place.store) == ["m1"]
    finally:
        service.communicate()
    assert not is_in_use(place.store)
    place.restore(force=True)


def test_every_flipped_byte_and_every_cut_is_noticed(place, tmp_path):
    place.backup()
    whole, before, damaged = place.file.read_bytes(), place.files(), tmp_path / "damaged"
    content = len(whole.rstrip(b"\0"))
    with tarfile.open(place.file) as tar:
        hot = [m.offset_data + k for m in tar.getmembers() for k in (0, m.size // 2, m.size - 1)]
    for at in [*hot, *range(0, content, 701)]:
        damaged.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        said = ""
        try:
            with open_archive(damaged) as archive:
                archive.extract(None, lambda n: None)
        except ConfigError as error:
            said = str(error)
        assert "\n" not in said
        assert said or _is_beside_content(whole, at), f"byte {at} was flipped, and nobody noticed"
    for n in range(0, content, 997):
        damaged.write_bytes(whole[:n])
        with pytest.raises(ConfigError, match=r"damaged|no backup"):
            restore(damaged, state=place.state, looks=place.looks, force=True)
    assert place.files() == before


def _is_beside_content(whole: bytes, at: int) -> bool:
    """Whether a byte is none of a file's content: zeros between files, or what a header says beside name and size."""
    with tarfile.open(fileobj=io.BytesIO(whole)) as tar:
        return not any(m.offset_data <= at < m.offset_data + m.size for m in tar.getmembers())


@pytest.mark.parametrize("name", ["/etc/passwd", "state/../../evil", "../evil", "evil", "state/1f0c/planner.sqlite"])
def test_an_archive_with_strange_names_is_refused(place, tmp_path, name):
    place.backup()
    evil = tmp_path / "evil.tar"
    with tarfile.open(place.file) as source, tarfile.open(evil, "w") as target:
        for k, member in enumerate(source.getmembers()):
            target.addfile(member, source.extractfile(member))
            if k == 1:
                added = tarfile.TarInfo(name)
                added.size = 4
                target.addfile(added, io.BytesIO(b"evil"))
                target.addfile(added, io.BytesIO(b"evil"))
    with pytest.raises(ConfigError, match=r"no backup has|isn't what was saved"):
        restore(evil, state=tmp_path / "new" / "state", looks=tmp_path / "new" / "looks")
    assert not [path for path in tmp_path.rglob("evil") if path.is_file()]
    assert not [path for path in (tmp_path / "new").rglob("*") if path.is_file()]


@pytest.mark.parametrize("kind", [tarfile.SYMTYPE, tarfile.LNKTYPE, tarfile.CHRTYPE, tarfile.GNUTYPE_SPARSE])
def test_an_archive_with_what_is_no_file_is_refused(place, tmp_path, kind):
    place.backup()
    evil = tmp_path / "evil.tar"
    with tarfile.open(place.file) as source, tarfile.open(evil, "w") as target:
        head = source.getmembers()[0]
        target.addfile(head, source.extractfile(head))
        link = tarfile.TarInfo("state/x")
        link.type, link.linkname = kind, "/etc/passwd"
        target.addfile(link)
    with pytest.raises(ConfigError, match=r"no backup has|damaged"):
        restore(evil, state=tmp_path / "new")


def test_other_files_and_other_formats_are_named(place, tmp_path):
    foreign = tmp_path / "foreign"
    for data in (b"", b"hello", bytes(20_000), b"SQLite format 3\0" + bytes(5000)):
        foreign.write_bytes(data)
        with pytest.raises(ConfigError, match=r"is no backup of SurveilNav"):
            restore(foreign, state=place.state, check=True)
    with tarfile.open(foreign, "w") as tar:
        member = tarfile.TarInfo("surveilnav-backup.json")
        member.size = len(data := b'{"format": 99}')
        tar.addfile(member, io.BytesIO(data))
    with pytest.raises(ConfigError, match=r"format 99; this program reads format 1"):
        restore(foreign, state=place.state, check=True)


def test_a_damaged_store_is_named_and_an_empty_folder_too(place, tmp_path):
    place.store.write_bytes(b"SQLite format 3\0" + b"\xff" * 9000)
    with pytest.raises(ConfigError, match=r"the store .*planner.sqlite (can't be read|is damaged)"):
        place.backup()
    assert not place.file.exists()
    assert store_files(tmp_path / "nowhere") == []
    with pytest.raises(ConfigError, match=r"there are no stores in"):
        backup(place.file, state=tmp_path / "nowhere", looks=place.looks)


def test_if_the_disk_is_full_the_former_stores_stay(place, monkeypatch):
    place.backup()
    before, move = place.files(), __import__("shutil").move
    moved = []

    def full(source, target):
        moved.append(target)
        if len(moved) == len(before) + 1:
            raise OSError(28, "No space left on device")
        return move(source, target)

    monkeypatch.setattr("surveilnav.cli.backup.shutil.move", full)
    with pytest.raises(OSError, match=r"No space"):
        place.restore(force=True)
    assert place.files() == before
