"""The planner's store: what is written is read again, and what can't be read or written is named."""

from __future__ import annotations

import sqlite3
import subprocess
import sys
from types import SimpleNamespace

import msgspec
import pytest
from structlog.testing import capture_logs

from surveilnav.messages import Candidate, MissionStatus, Plan
from surveilnav.services.planner.core import MissionState
from surveilnav.services.planner.store import VERSION, PassageWait, PendingAction, SavedMission, Store, StoreError


def saved(id="m1", **more):
    status = MissionStatus(
        stamp_ns=1,
        mission=id,
        target="chair",
        robot="r1",
        state="active",
        phase="exploring",
        step=7,
        max_steps=500,
        path_m=1.25,
        started_ns=1,
    )
    return SavedMission(status=status, **more)


def full(id="m1"):
    waypoint = Candidate("stairs", 1.0, 2.0, 0.5, True)
    return saved(
        id,
        robot_path_m=1.0,
        cancel="enough",
        waits_for=PassageWait(reason="waits for door lobby", floor="0", passages=("lobby", "lift_1")),
        vouched=frozenset({("0", "entrance"), ("1", "entrance")}),
        frame_problem_reported=True,
        memory=MissionState("chair").to_json().decode(),
        pending=PendingAction(seq=41, action="take_stairs", to_floor="1"),
        plan=Plan(
            stamp_ns=1,
            mission=id,
            robot="r1",
            floor="0",
            step=7,
            seq=41,
            action="take_stairs",
            waypoint=waypoint,
            path_m=[(1.0, 2.0)],
            candidates=[waypoint],
        ),
    )


@pytest.fixture
def open_store(tmp_path):
    """``open_store(path)``: stores as a planner opens them, closed at the test's end."""
    import structlog

    opened = []

    def open_store(path=None):
        node = SimpleNamespace(log=structlog.get_logger())
        opened.append(Store(str(path if path is not None else tmp_path / "new folder" / "planner.sqlite"), node))
        return opened[-1]

    yield open_store
    for store in opened:
        store.close()


def test_missions_come_back_as_they_were_in_the_order_they_came(open_store):
    store = open_store()
    missions = [saved("z"), full("a"), saved("m")]
    for mission in missions:
        store.save(mission, sync=True)
    changed = msgspec.structs.replace(missions[0], robot_path_m=3.0)
    store.save(changed)
    store.close()
    assert open_store().load() == [changed, *missions[1:]]


def test_a_mission_of_before_pauses_were_stored_is_read(open_store, tmp_path):
    path = tmp_path / "planner.sqlite"
    store = open_store(path)
    store.save(full())
    store.close()
    with sqlite3.connect(path) as connection:
        connection.execute(
            "UPDATE missions SET record = json_remove(record, '$.waits_for', '$.vouched', '$.frame_problem_reported')"
        )
    connection.close()
    former = msgspec.structs.replace(full(), waits_for=None, vouched=frozenset(), frame_problem_reported=False)
    assert open_store(path).load() == [former]


def test_deleted_missions_are_gone(open_store):
    store = open_store()
    for id in "abc":
        store.save(saved(id), finished=True)
    store.delete(["a", "c"])
    store.close()
    assert [m.status.mission for m in open_store().load()] == ["b"]


def test_what_was_saved_survives_kill_9(open_store, tmp_path):
    """Every save that returned is there, whenever the process dies."""
    path = tmp_path / "planner.sqlite"
    code = f"""
from types import SimpleNamespace
import msgspec, structlog
from surveilnav.services.planner.store import SavedMission, Store
from surveilnav.messages import MissionStatus
store, k = Store({str(path)!r}, SimpleNamespace(log=structlog.get_logger())), 0
while True:
    status = MissionStatus(stamp_ns=k, mission=f"m{{k % 5}}", target="chair", robot="r1", state="active", phase="",
                           step=k, max_steps=500, path_m=0.0)
    store.save(SavedMission(status=status, memory="x" * 5000), sync=k % 7 == 0)
    print(k, flush=True)
    k += 1
"""
    for lines in (1, 17, 203):
        process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        last = [process.stdout.readline() for _ in range(lines)][-1]
        process.kill()
        rest, _ = process.communicate()
        acknowledged = int((rest.splitlines() or [last])[-1] or last)
        store = open_store(path)
        newest = max(m.status.step for m in store.load())
        assert newest in (acknowledged, acknowledged + 1), "the last may have been written and not yet been spoken of"
        store.close()


def test_without_a_path_nothing_is_kept(open_store, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    store = open_store("")
    store.save(saved())
    assert store.load() == []
    assert list(tmp_path.iterdir()) == []


def text(path):
    path.write_text("this is no database, whatever its name says\n" * 100)


def torn(path):
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])


def scribbled(path):
    data = bytearray(path.read_bytes())
    data[4096:12288] = b"\xa5" * 8192
    path.write_bytes(bytes(data))


def of_version(path, version):
    with sqlite3.connect(path) as connection:
        connection.execute(f"PRAGMA user_version = {version}")
    connection.close()


def newer(path):
    of_version(path, VERSION + 1)


def older(path):
    of_version(path, VERSION - 2)


@pytest.mark.parametrize(
    ("damage", "name"),
    [
        (text, "store_corrupt"),
        (torn, "store_corrupt"),
        (scribbled, "store_corrupt"),
        (newer, "store_version"),
        (older, "store_version"),
    ],
)
def test_a_store_that_cannot_be_read_is_named_set_aside_and_begun_anew(open_store, tmp_path, damage, name):
    path = tmp_path / "planner.sqlite"
    store = open_store(path)
    for k in range(50):
        store.save(full(f"m{k}"))
    store.close()
    damage(path)
    before = path.read_bytes()
    with capture_logs() as logs:
        store = open_store(path)
        assert store.load() == []
    assert [entry["event"].startswith(name) for entry in logs] == [True], logs
    aside = [p for p in tmp_path.glob("planner.sqlite.2*") if not p.name.endswith(("-wal", "-shm"))]
    assert [p.read_bytes() for p in aside] == [before], "what was there is kept for who can mend it"
    store.save(saved("after"))
    store.close()
    assert [m.status.mission for m in open_store(path).load()] == ["after"]


def test_one_mission_that_cannot_be_read_costs_no_other(open_store, tmp_path):
    path = tmp_path / "planner.sqlite"
    store = open_store(path)
    store.save(saved("a"))
    store.save(saved("b"))
    store.close()
    with sqlite3.connect(path) as connection:
        connection.execute("UPDATE missions SET record = '{\"status\": 3}' WHERE id = 'a'")
    connection.close()
    with capture_logs() as logs:
        assert [m.status.mission for m in open_store(path).load()] == ["b"]
    assert [(e["mission"], e["event"].split(":")[0]) for e in logs] == [("a", "store_unreadable")]


def test_a_place_that_cannot_be_written_is_named_and_tried_again(open_store, tmp_path):
    blocked = tmp_path / "a file"
    blocked.write_text("in the way")
    store = open_store(blocked / "planner.sqlite")
    with pytest.raises(StoreError, match=r"a file/planner.sqlite.*SURVEILNAV_PLANNER__STORE"):
        store.load()
    blocked.unlink()
    store.save(saved())  # mended meanwhile
    assert len(store.load()) == 1


def test_a_full_disk_is_named_and_heals(open_store, tmp_path):
    path = tmp_path / "planner.sqlite"
    store = open_store(path)
    store.save(saved("a"))
    store._open.execute("PRAGMA max_page_count = 4")  # what SQLite says when a disk is full
    large = msgspec.structs.replace(saved("b"), memory="x" * 100_000)
    with pytest.raises(StoreError, match="full"):
        store.save(large)
    store.save(saved("c"))  # there is room again
    assert {"a", "c"} <= {m.status.mission for m in store.load()}


def test_whether_there_is_room_again_is_found_out_without_a_mission(open_store, tmp_path):
    folder = tmp_path / "folder"
    folder.write_text("in the way")
    store = open_store(folder / "planner.sqlite")
    store.retry()
    assert store.problem == "", "it wasn't asked for anything yet"
    with pytest.raises(StoreError):
        store.save(saved())
    store.retry()
    assert "can't be used" in store.problem
    folder.unlink()
    store.retry()
    assert store.problem == ""


def test_people_can_read_it(open_store, tmp_path):
    path = tmp_path / "planner.sqlite"
    open_store(path).save(full())
    connection = sqlite3.connect(path)
    assert connection.execute("SELECT json_extract(record, '$.status.target') FROM missions").fetchone() == ("chair",)
    connection.close()
