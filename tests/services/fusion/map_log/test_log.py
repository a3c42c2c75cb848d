"""The maps and their file: what is read again, and what happens when it can't be read or written."""

from __future__ import annotations

import sqlite3
import threading
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from surveilnav.sensing.packing import decode_frame
from surveilnav.sensing.scans import encode_scan
from surveilnav.services.fusion.core.snapshot import dump
from surveilnav.services.fusion.map_log import snapshots
from surveilnav.services.fusion.map_log.log import LogState
from surveilnav.services.fusion.map_log.store import Store, StoreError
from surveilnav.services.fusion.perceived import PerceivedView
from tests.fusion_run import Run


def log_size(store):
    """(views, bytes of their pictures) in a store's log."""
    with store._reading() as db:
        return db.execute("SELECT COUNT(*), COALESCE(SUM(LENGTH(payload)), 0) FROM view").fetchone()


@pytest.fixture
def run(tmp_path, tools):
    started = []

    def start(**settings) -> Run:
        started.append(Run(tmp_path / "fusion.sqlite", tools, **settings))
        return started[-1]

    yield start
    for r in started:
        r.close()


def steady(tools, tmp_path, seqs) -> bytes:
    """The maps of a run without a file."""
    undisturbed = Run("", tools, store="")
    undisturbed.take(*seqs)
    return dump(undisturbed.maps.joint)


@pytest.mark.parametrize("snapshot_views", [3, 1000])
def test_what_was_taken_is_there_after_a_restart(run, tools, tmp_path, snapshot_views):
    r = run(snapshot_views=snapshot_views)
    for begin in (1, 6, 11):
        r.take(*range(begin, begin + 5))
        r.log.integrate([r.view(begin, source="camera/c")])
        before = r.maps
        r.close()
        r.start()
        assert dump(r.maps.joint) == dump(before.joint)
        for name in ("robots", "views", "digests", "faults"):
            assert getattr(r.maps.processed, name) == getattr(before.processed, name), name
        assert (r.node.said, r.node.rejected) == (["restored"], [])
    assert r.maps.processed.robots["r"].seq == 15
    assert r.maps.processed.digests["camera/c", 0] == bytes([11]) * 16


@pytest.mark.parametrize("snapshot_views", [2, 1000])
def test_laser_scans_are_there_to_the_bit_after_a_restart(run, snapshot_views):
    r = run(snapshot_views=snapshot_views)
    for seq in range(1, 6):
        p = r.view(seq)
        x, y, _ = p.header.T_world_camera.translation_m
        scan = encode_scan((x, y, 0.2), 0.1 * seq, 0.02, np.linspace(0.5, 3.0, 300), 10.0)
        header = msgspec.structs.replace(p.header, scan=scan)
        r.log.integrate([replace(p, header=header, view=decode_frame(header, p.payload))])
    before = dump(r.maps.joint)
    assert sum(f.geometry.state()["layers"]["scan_hits"].sum() for f in r.maps.joint._floors.values()) > 100
    r.close()
    r.start()
    assert dump(r.maps.joint) == before


def test_refused_views_stay_refused_after_a_restart(run):
    r = run()
    r.take(1, 2)
    r.log.integrate([r.view(3, x=4.0)])
    assert r.node.rejected == ["view.pose_jump"]
    before = r.maps
    r.close()
    r.start()
    assert r.maps.processed.faults == before.processed.faults != {}
    assert (r.maps.processed.robots["r"].seq, r.maps.joint.revision, r.node.rejected) == (3, 2, [])
    r.log.integrate([r.view(4, x=4.0)])  # it stands by it: the one before the restart counts
    assert r.maps.joint.revision == 3


def test_nothing_is_taken_while_the_disk_is_full(run, tools, tmp_path):
    r = run()
    r.take(1, 2)
    r.log._store.close()
    db = sqlite3.connect(r.path)
    r.log._store._max_pages = db.execute("PRAGMA page_count").fetchone()[0]  # SQLite's own "database or disk is full"
    db.close()
    r.take(3)
    before = r.maps.joint.revision
    r.take(4)
    assert (before, r.maps.joint.revision, r.maps.processed.robots["r"].seq) == (2, 2, 2)
    assert "full" in r.log.problem
    assert "the store can't be written" in r.node.said
    r.log._store.close()
    r.log._store._max_pages = 0
    r.log.integrate([])  # nothing new, but there is room again: what waited goes on (the robot's newest view)
    assert (r.maps.joint.revision, r.maps.processed.robots["r"].seq, r.log.problem) == (3, 4, "")
    r.close()
    r.start()
    assert r.maps.processed.robots["r"].seq == 4
    assert dump(r.maps.joint) == steady(tools, tmp_path, (1, 2, 4))


def test_a_file_that_cannot_be_opened_holds_views_up_and_loses_none(run, tmp_path):
    r = run()
    r.take(1, 2)
    r.close()
    real = tmp_path / "fusion.sqlite"
    real.rename(tmp_path / "away")
    real.mkdir()  # nothing that SQLite could open
    r.start()
    r.take(3)
    assert r.maps.joint.revision == 0
    assert "can't be written" in r.log.problem
    real.rmdir()
    (tmp_path / "away").rename(real)
    r.log.integrate([])
    assert (r.maps.joint.revision, r.maps.processed.robots["r"].seq, r.log.problem) == (3, 3, "")


def test_a_file_that_is_none_is_set_aside_and_said(run, tmp_path):
    path = tmp_path / "fusion.sqlite"
    path.write_bytes(b"no database at all " * 1000)
    r = run()
    assert r.node.said == ["store_corrupt"]
    assert path.with_name("fusion.sqlite.corrupt").read_bytes().startswith(b"no database")
    r.take(1)
    r.close()
    assert r.start().joint.revision == 1


def corrupt(path, statement: str, *values) -> None:
    db = sqlite3.connect(path)
    with db:
        assert db.execute(statement, values).rowcount > 0
    db.close()


@pytest.mark.parametrize("log_views", [0, 1000])
@pytest.mark.parametrize("views", [5, 14])  # one snapshot, or two and a log that was pruned
def test_a_damaged_snapshot_costs_time_and_no_view(run, views, log_views):
    r = run(snapshot_views=4, log_views=log_views)
    for seq in range(1, views + 1):
        r.take(seq)
        r.log._snapshots.wait()
    before = dump(r.maps.joint)
    r.close()
    corrupt(r.path, "UPDATE piece SET data = zeroblob(100) WHERE snapshot = (SELECT MAX(id) FROM snapshot)")
    r.start()
    assert r.node.said == ["snapshot_corrupt", "restored"]
    assert dump(r.maps.joint) == before


@pytest.mark.parametrize(
    "part",
    [
        "payload = zeroblob(1000)",
        "reply = (SELECT reply FROM view WHERE number = 1)",
        "source = CAST(x'ff' AS TEXT)",
        "fault = CAST(x'80' AS TEXT)",
    ],
)
def test_a_damaged_view_is_said_and_costs_that_view(run, tools, tmp_path, part):
    r = run()
    r.take(1, 2, 3, 4)
    r.close()
    corrupt(r.path, f"UPDATE view SET {part} WHERE number = 2")
    corrupt(r.path, "DELETE FROM view WHERE number = 3")
    r.start()
    assert r.node.said == ["log_view_lost", "log_gap", "restored"]
    assert dump(r.maps.joint) == steady(tools, tmp_path, (1, 4))


def test_a_page_of_garbage_is_survived_with_what_could_be_read(run):
    r = run(snapshot_views=4)
    for seq in range(1, 10):
        r.take(seq)
        r.log._snapshots.wait()
    r.close()
    data = bytearray(r.path.read_bytes())
    rng = np.random.default_rng(0)
    for page in range(1, len(data) // 4096):
        data[4096 * page : 4096 * page + 64] = rng.bytes(64)
    r.path.write_bytes(bytes(data))
    r.start()
    assert r.node.said[-1] in ("store_corrupt", "restored", "log_gap")
    assert any(s.startswith(("store_corrupt", "snapshot_corrupt", "log_")) for s in r.node.said)
    revision = r.maps.joint.revision
    r.take(20)
    assert r.maps.joint.revision == revision + 1
    r.close()
    assert r.start().joint.revision == revision + 1  # and from then on nothing is lost any more


def test_a_file_damaged_where_a_restart_does_not_read_is_replaced_with_the_maps(run):
    r = run(snapshot_views=4)
    for seq in range(1, 10):
        r.take(seq)
        r.log._snapshots.wait()
    before = dump(r.maps.joint)
    r.close()
    overwrite_page_of(r.path, "event_of")
    r.start()
    assert r.node.said == ["store_corrupt", "restored"]
    assert r.path.with_name("fusion.sqlite.corrupt").exists()
    assert dump(r.maps.joint) == before
    r.take(10)
    assert r.log._store.damage() == ""
    before = dump(r.maps.joint)
    r.close()
    assert dump(r.start().joint) == before
    assert r.maps.processed.robots["r"].seq == 10


def overwrite_page_of(path, name: str) -> None:
    """Writes garbage over the first page of a table or an index."""
    with sqlite3.connect(path) as db:
        (page,) = db.execute("SELECT rootpage FROM sqlite_master WHERE name = ?", (name,)).fetchone()
        (size,) = db.execute("PRAGMA page_size").fetchone()
    db.close()
    with path.open("r+b") as file:
        file.seek((page - 1) * size)
        file.write(np.random.default_rng(0).bytes(size))


def test_another_version_or_another_voxel_size_is_set_aside_and_said(run):
    r = run(snapshot_views=2)
    r.take(1, 2, 3)
    r.close()
    r.start(map={"voxel_m": 0.05})
    assert r.node.said == ["store_other_config"]
    assert r.path.with_name("fusion.sqlite.other_config").exists()
    r.take(1)
    r.close()
    corrupt_version = sqlite3.connect(r.path)
    corrupt_version.execute("PRAGMA user_version = 7")
    corrupt_version.close()
    r.start()
    assert r.node.said == ["store_other_version"]
    assert r.maps.joint.revision == 0
    assert r.path.with_name("fusion.sqlite.other_version").exists()


def test_the_file_stays_bounded(run):
    """Two snapshots, the log since the older one, and room for a third snapshot while it is written."""
    r = run(snapshot_views=10, max_events=50, log_views=0)
    for seq in range(1, 121):
        r.take(seq)
        r.log._snapshots.wait()
    views, n_bytes = log_size(r.log._store)
    assert 10 <= views <= 20
    assert r.path.stat().st_size < 3.5 * len(dump(r.maps.joint)) + 2 * n_bytes + 1_000_000
    assert r.path.with_name("fusion.sqlite-wal").stat().st_size < 70 << 20
    db = sqlite3.connect(r.path)
    assert db.execute("SELECT COUNT(*) FROM event").fetchone()[0] == 50
    assert db.execute("SELECT COUNT(*) FROM snapshot").fetchone()[0] == 2
    db.close()


def test_histories_are_whole_across_restarts(run):
    r = run(objects={"max_history": 2}, snapshot_views=4)
    everything: dict[int, list] = {}
    accept = type(r.maps.joint).accept

    def watched(joint, view, perception):
        done = accept(joint, view, perception)
        for h in done.changes if done else ():
            everything.setdefault(h.object_id, []).append(h.event)
        return done

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(type(r.maps.joint), "accept", watched)
        for seq in range(1, 13):
            r.take(seq)
    r.close()
    r.start()
    records = r.maps.joint.objects("0")
    assert records
    for record in records:
        assert r.log.object_history("0", record.id) == everything[record.id]
        assert record.history == everything[record.id][-2:]


def test_events_written_again_are_there_once(run):
    r = run()
    r.take(1, 2, 3)
    for _ in range(2):
        history = r.log.object_history("0", 1)
        r.close()
        r.start()
        assert r.log.object_history("0", 1) == history != []


def test_a_file_that_breaks_while_it_is_used_is_replaced_without_loss(run):
    r = run()
    r.take(1, 2)
    with pytest.MonkeyPatch.context() as patch:

        def broken(entries):
            raise StoreError("corrupt", "database disk image is malformed")

        patch.setattr(r.log._store, "append", broken)
        r.take(3)
    assert r.node.said[-1] == "store_corrupt"
    assert r.maps.processed.robots["r"].seq == 2
    r.take(3)
    before = dump(r.maps.joint)
    r.close()
    assert dump(r.start().joint) == before
    assert r.maps.processed.robots["r"].seq == 3


# --- files that are begun anew --------------------------------------------------------------------------------------


def broken(name: str, calls: list[str] | None = None):
    def fail(*_):
        if calls is not None:
            calls.append(name)
        raise StoreError(name, "made to fail")

    return fail


def test_a_new_file_takes_no_view_before_it_holds_the_maps(run):
    r = run()
    r.take(1, 2)
    store, tried = r.log._store, []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "append", broken("corrupt"))
        patch.setattr(store, "save", broken("unwritable", tried))
        r.take(3)
        patch.setattr(store, "append", type(store).append.__get__(store))  # the new file can be written, but is full
        r.take(4)
        r.take(5)
        assert (r.maps.joint.revision, r.maps.processed.robots["r"].seq, log_size(store)[0]) == (2, 2, 0)
        assert r.log.is_blocked
        assert tried
    r.log.integrate([])
    assert (r.maps.processed.robots["r"].seq, r.log.problem) == (5, "")
    before = dump(r.maps.joint)
    r.close()
    assert dump(r.start().joint) == before


def test_nor_at_the_start(run):
    r = run()
    r.take(1, 2)
    r.close()

    def torn(store, after):
        entries = whole(store, after)
        yield next(entries)
        raise StoreError("corrupt", "made to fail")

    whole = Store.log
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Store, "log", torn)
        patch.setattr(Store, "save", broken("unwritable"))
        r.start()
        patch.setattr(Store, "log", whole)
        r.take(3)
        assert (r.maps.joint.revision, r.maps.processed.robots["r"].seq) == (1, 1)
    r.log.integrate([])
    assert (r.maps.joint.revision, r.maps.processed.robots["r"].seq) == (2, 3)
    before = dump(r.maps.joint)
    r.close()
    assert dump(r.start().joint) == before


def test_a_snapshot_that_is_being_written_ends_in_the_file_it_was_begun_for(run):
    r = run()
    r.take(1, 2)
    store, moved, where = r.log._store, threading.Event(), []
    real_save, real_aside = store.save, store.set_aside

    def slowly(*what):
        where.append(moved.wait(0.5))
        real_save(*what)

    def aside(*what, **how):
        moved.set()
        return real_aside(*what, **how)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(store, "save", slowly)
        patch.setattr(store, "set_aside", aside)
        r.log._snapshots.write(r.maps.freeze())
        patch.setattr(store, "append", broken("corrupt"))
        r.take(3)
    assert where == [False]


def test_a_snapshot_that_cannot_be_made_is_said(run):
    r = run()
    r.log._snapshots._write({"number": 1, "what": 2**70}, wipe=False)
    assert r.node.said == ["a snapshot can't be written"]


@pytest.mark.parametrize("when", ["pruned", "begun anew"])
def test_lost_snapshots_are_kept_for_whoever_can_repair_them(run, when):
    r = run(snapshot_views=4 if when == "pruned" else 100, log_views=0)
    for seq in range(1, 12):
        r.take(seq)
        r.log._snapshots.wait()
    if when == "begun anew":
        r.log._begin_new_file("corrupt", "made to fail")
        assert r.log.state is LogState.LACKS_MAPS
        r.take(12)
    r.close()
    corrupt(r.path, "UPDATE piece SET data = zeroblob(100)")
    r.start()
    assert "snapshots_lost" in r.node.said
    copy = Store(r.path.with_name("fusion.sqlite.snapshots_lost"))
    assert [read() for _, _, read in copy.snapshots()] == [None] * (2 if when == "pruned" else 1)
    copy.close()
    assert 0 < r.maps.joint.revision < 11  # what the log still holds
    r.take(20)
    r.close()
    assert r.start().processed.robots["r"].seq == 20


# --- what is held ---------------------------------------------------------------------------------------------------


def faulty(r, seq: int, source: str) -> PerceivedView:
    return PerceivedView((source, 0), r.view(seq, source).header, fault="unreadable: made so")


def test_what_is_of_no_use_buys_no_snapshot_and_is_logged_when_it_changes(run):
    r = run(snapshot_views=2)
    for seq in range(1, 6):
        r.log.integrate(
            [faulty(r, seq, "camera/c"), faulty(r, seq, "robot/r"), r.view(seq, x=1.0 if seq == 1 else 20.0 * seq)]
        )
    for seq in range(1, 6):
        r.log.integrate([faulty(r, seq, "camera/c")])
    entries = [e for _, e in r.log._store.log(0)]
    assert len([e for e in entries if e.source == "camera/c"]) == 1
    assert r.node.rejected.count("view.unreadable") >= 10
    assert r.maps.joint.revision == 1
    assert (r.log._snapshots._thread, r.maps.processed.robots["r"].seq) == (None, 5)
    r.log.integrate([r.view(6, "camera/c")])
    assert r.log._snapshots._thread is not None


def test_only_what_the_maps_took_need_not_be_looked_at_again(run, tmp_path):
    r = run()
    camera = "camera/c"
    r.log.integrate([r.view(1, camera)])
    r.log.integrate([r.view(2, camera, x=4.0)])  # it was moved
    assert r.maps.processed.digests == {(camera, 0): bytes([1]) * 16}
    assert r.node.rejected == ["view.pose_jump"]
    r.log.integrate([r.view(3, camera, x=4.0)])  # and stands by it
    assert r.maps.processed.digests == {(camera, 0): bytes([3]) * 16}
    assert (r.maps.joint.revision, r.maps.processed.faults) == (2, {})
    r.log.integrate([r.view(3, camera, x=4.0)])
    assert log_size(r.log._store)[0] == 3
    r.close()
    away = r.path.rename(tmp_path / "away")
    r.path.mkdir()
    camera_view, digest = (camera, 0), bytes([3]) * 16
    assert not r.start().processed.contains(camera_view, digest)
    r.path.rmdir()
    away.rename(r.path)
    r.take(1)
    assert r.maps.processed.contains(camera_view, digest)
    assert not r.maps.processed.contains(camera_view, bytes([1]) * 16)
    assert not r.maps.processed.contains(camera_view, b"")


def bytes_on_disk(run) -> bytes:
    """All that lies in the store's folder."""
    return b"".join(path.read_bytes() for path in sorted(run.path.parent.glob("fusion.sqlite*")))


def has_picture_of(run, seq: int) -> bool:
    """Whether a stretch of a view's payload lies anywhere in the store's folder."""
    return bytes(run.view(seq).payload[200:264]) in bytes_on_disk(run)


def settle(run) -> None:
    """Turns of the loop without news, until no snapshot is being written."""
    for _ in range(4):
        run.log.integrate([])
        run.log._snapshots.wait()


@pytest.mark.parametrize("keeps", [None, 3600.0])
def test_pictures_that_shall_be_forgotten_are_nowhere_in_the_file(run, tools, tmp_path, keeps):
    r = run(snapshot_views=1000)
    r.start(keeps)
    r.take(*range(1, 9))
    aside = r.path.with_name("fusion.sqlite.corrupt")
    aside.write_bytes(bytes(r.view(3).payload))
    settle(r)
    assert all(has_picture_of(r, seq) for seq in range(1, 9))
    assert aside.exists()
    maps, objects = dump(r.maps.joint), r.maps.joint.objects("0")
    assert r.log.forget_pictures()
    settle(r)
    assert not any(has_picture_of(r, seq) for seq in range(1, 9))
    assert not aside.exists()
    assert "pictures_forgotten" in r.node.said
    r.take(9)
    r.close()
    r.start()
    assert dump(r.maps.joint) == steady(tools, tmp_path, range(1, 10)), "the maps stay, and go on"
    assert maps != dump(r.maps.joint)
    assert r.log.object_history("0", objects[0].id)


def test_pictures_go_when_they_are_old(run, monkeypatch):
    """With an age of 100 s: nothing is younger than it must be, nothing stays longer, also where no view comes any more."""
    now_s = 1000.0
    monkeypatch.setattr(snapshots.time, "monotonic", lambda: now_s)
    r = run(snapshot_views=1000)
    r.start(100.0)
    r.take(1, 2)
    now_s = 1049.0
    settle(r)
    assert log_size(r.log._store)[0] == 2
    now_s = 1051.0
    r.take(3)
    settle(r)
    assert has_picture_of(r, 1), "the log is needed until there are two snapshots"
    now_s = 1099.0
    settle(r)
    assert has_picture_of(r, 1)
    now_s = 1102.0
    settle(r)
    assert not any(has_picture_of(r, seq) for seq in (1, 2, 3))
    count = r.log._store._connection.execute("SELECT MAX(id) FROM snapshot").fetchone()[0]
    now_s = 9999.0
    settle(r)
    assert r.log._store._connection.execute("SELECT MAX(id) FROM snapshot").fetchone()[0] == count, (
        "an empty log is left alone"
    )


def test_after_a_restart_with_an_age_the_log_is_emptied(run):
    """Nobody knows how long its pictures have lain there."""
    r = run(snapshot_views=1000)
    r.take(1, 2, 3)
    r.close()
    r.start(3600.0)
    settle(r)
    assert not has_picture_of(r, 2)


def test_pictures_that_cant_be_forgotten_now_are_later(run, monkeypatch):
    now_s = 1000.0
    monkeypatch.setattr(snapshots.time, "monotonic", lambda: now_s)
    r = run(snapshot_views=1000)
    r.take(1, 2)
    save = r.log._store.save
    monkeypatch.setattr(r.log._store, "save", lambda *_: (_ for _ in ()).throw(StoreError("unwritable", "full")))
    r.log.forget_pictures()
    settle(r)
    assert "a snapshot can't be written" in r.node.said
    monkeypatch.setattr(r.log._store, "save", save)
    settle(r)
    assert has_picture_of(r, 1), "it rests for a while"
    now_s = 1040.0
    settle(r)
    assert not has_picture_of(r, 1)
