"""Taking a source's contribution out of the maps: they are what they would be had it never been there."""

from __future__ import annotations

import threading
import time
from concurrent.futures import Future

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.bus import Refused
from surveilnav.services.fusion.core.maps.provenance import Agreement
from surveilnav.services.fusion.core.snapshot import dump
from surveilnav.services.fusion.map_log import rebuild
from surveilnav.services.fusion.map_log.rebuild import MapRebuild
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.map_log.removals import RemovalRequest
from surveilnav.services.fusion.map_log.store import StoreError
from tests.fusion_run import Run

SOURCES = ("robot/r", "camera/a", "camera/b")
PROCESSED = ("views", "digests", "faults", "spans")


@pytest.fixture
def run(tmp_path, tools):
    started = []

    def start(**more) -> Run:
        started.append(Run(tmp_path / "fusion.sqlite", tools, **more))
        return started[-1]

    yield start
    for r in started:
        r.close()


def ask(run: Run, source: str, since_s: float | None = None, until_s: float | None = None) -> Removal:
    """Asks for a removal as a query does, from another thread; the main loop's turns go on meanwhile."""
    since_ns, until_ns = (None if s is None else int(s * 1e9) for s in (since_s, until_s))
    answers: list = []

    def asking() -> None:
        try:
            answers.append(run.log.removals.ask(source, since_ns, until_ns))
        except Refused as refused:
            answers.append(refused)

    thread = threading.Thread(target=asking)
    thread.start()
    while thread.is_alive():
        run.log.integrate([])
        thread.join(0.001)
    if isinstance(answers[0], Refused):
        raise answers[0]
    return answers[0]


def finish(run: Run) -> Removal:
    """Turns of the main loop until nothing is being removed any more; the newest removal."""
    until_s = time.monotonic() + 60
    while run.log.removals.known[-1].state == "running":
        assert time.monotonic() < until_s
        run.log.integrate([])
        time.sleep(0.001)
    return run.log.removals.known[-1]


def integrate(run: Run, script: list[tuple[str, int]]) -> None:
    for source, seq in script:
        run.log.integrate([run.view(seq, source)])


def clean(tools, script: list[tuple[str, int]]) -> Run:
    """A run that never got anything but this."""
    made = Run("", tools, store="")
    integrate(made, script)
    return made


def objects_and_histories(run: Run, expected: Run) -> None:
    """Everything that is answered of objects is the same, with the histories in the file."""
    for floor in expected.maps.joint.floors:
        wanted = expected.maps.joint.objects(floor)
        assert run.maps.joint.objects(floor) == wanted
        for record in wanted:
            assert run.log.object_history(floor, record.id) == record.history


def assert_same(run: Run, expected: Run) -> None:
    assert dump(run.maps.joint) == dump(expected.maps.joint)
    for name in PROCESSED:
        assert getattr(run.maps.processed, name) == getattr(expected.maps.processed, name), name


#: Who looks when: each source counts its own views.
ORDERS = st.lists(st.sampled_from(SOURCES), min_size=4, max_size=14)


def numbered(order: list[str]) -> list[tuple[str, int]]:
    return [(source, k + 1) for k, source in enumerate(order)]


def test_a_time_span_is_taken_out(run, tools):
    r = run(snapshot_views=3)
    script = numbered(["robot/r", "camera/a", "robot/r", "camera/b", "camera/a", "camera/a", "robot/r", "robot/r"])
    for view in script:
        integrate(r, [view])
        r.log._snapshots.wait()
    ask(r, "camera/a", since_s=4.5, until_s=5.5)
    assert finish(r).way == "replay"
    expected = clean(tools, [view for view in script if view != ("camera/a", 5)])
    assert_same(r, expected)
    ask(r, "robot/r", since_s=7.0)
    finish(r)
    assert_same(r, clean(tools, [v for v in script if v not in [("camera/a", 5), ("robot/r", 7), ("robot/r", 8)]]))
    assert r.maps.processed.robots["r"].seq == 8
    ask(r, "robot/r", until_s=2.0)
    finish(r)
    kept = [v for v in script if v not in [("camera/a", 5), ("robot/r", 7), ("robot/r", 8), ("robot/r", 1)]]
    assert_same(r, clean(tools, kept))
    r.close()
    r.start()
    assert_same(r, clean(tools, kept))
    assert [(x.id, x.state) for x in r.log.removals.known] == [(1, "done"), (2, "done"), (3, "done")]


def test_one_at_a_time_and_only_what_is_there(run, monkeypatch):
    r = run()
    integrate(r, numbered(["robot/r", "camera/a"]))
    with pytest.raises(Refused, match="hold no views of camera/b; they hold some of camera/a, robot/r"):
        ask(r, "camera/b")
    monkeypatch.setattr(MapRebuild, "is_complete", lambda self: False)
    ask(r, "camera/a")
    r.log.removals._requests.put(second := RemovalRequest("robot/r", None, None, Future()))
    r.log.removals.step(ready=True)
    with pytest.raises(Refused, match="still being removed"):
        second.answer.result(5)
    monkeypatch.undo()
    finish(r)
    monkeypatch.setattr(r.log._store, "put_removal", broken)
    with pytest.raises(Refused, match="store can't be written"):
        ask(r, "robot/r")
    assert r.maps.processed.spans.keys() == {"robot/r"}


def test_while_it_runs_no_snapshot_is_written_and_afterwards_one_is(run, monkeypatch):
    """A snapshot in between would drop the log that is being replayed."""
    r = run(snapshot_views=2, log_views=0)
    integrate(r, numbered(["robot/r", "camera/a"]))
    monkeypatch.setattr(MapRebuild, "is_complete", lambda self: False)
    ask(r, "camera/a")
    integrate(r, [("robot/r", k) for k in range(3, 12)])
    assert r.log.removals.is_running
    first = r.log._snapshots._thread
    assert first is None or not first.is_alive()
    assert r.log._store.first_number() == 1
    monkeypatch.undo()
    finish(r)
    r.log.integrate([])
    r.log._snapshots.wait()
    up_to, contents, _ = next(r.log._store.snapshots())
    assert (up_to, contents.removals, set(contents.spans)) == (11, 1, {"robot/r"})


@pytest.mark.parametrize("log_views", [0, 8, 1000])
def test_how_far_back_exactly(run, tools, log_views):
    """The way is told when it is asked for. With a short log, what was removed by provenance stays so after a restart."""
    r = run(snapshot_views=2, log_views=log_views)
    script = numbered(["robot/r", "camera/a", *["robot/r"] * 6, "camera/b", "robot/r", "robot/r"])
    for view in script:
        integrate(r, [view])
        r.log._snapshots.wait()
    wanted = {0: "provenance", 8: "provenance", 1000: "replay"}[log_views]
    assert ask(r, "camera/a").way == wanted
    ended = finish(r)
    assert ("reach back" in ended.message) == (wanted == "provenance")
    if wanted == "replay":
        assert_same(r, clean(tools, [v for v in script if v[0] != "camera/a"]))
    assert not owns_anything(r, "camera/a")
    assert r.maps.processed.views_of("a") == set()
    for _ in range(2):
        before = dump(r.maps.joint)
        integrate(r, [("robot/r", 20 + r.maps.number)])
        after = dump(r.maps.joint)
        assert before != after
        r.close()
        r.start()
        assert dump(r.maps.joint) == after
    # a later one, of a camera that the log does reach back to, goes around what was removed before
    if log_views:
        assert ask(r, "camera/b").way == "replay"
        finish(r)
        assert not owns_anything(r, "camera/a")
        assert not owns_anything(r, "camera/b")
        kept = dump(r.maps.joint)
        r.close()
        r.start()
        assert dump(r.maps.joint) == kept


def test_if_the_snapshot_without_the_source_is_damaged_it_is_out_by_provenance(run):
    r = run(snapshot_views=2, log_views=6)
    for view in numbered([*["robot/r"] * 8, "camera/a", "robot/r", "robot/r", "robot/r"]):
        integrate(r, [view])
        r.log._snapshots.wait()
    assert r.log._store.first_number() > 1
    with r.log._store._writing() as db:
        clean_ones = "SELECT id FROM snapshot WHERE up_to < 9"
        assert db.execute(f"UPDATE piece SET data = zeroblob(9) WHERE snapshot IN ({clean_ones})").rowcount > 0
    assert ask(r, "camera/a").way == "replay"
    ended = finish(r)
    assert (ended.state, ended.way, "reach back" in ended.message) == ("done", "provenance", True)
    assert not owns_anything(r, "camera/a")
    after = dump(r.maps.joint)
    r.close()
    r.start()
    assert dump(r.maps.joint) == after
    assert r.log.removals.known[-1].way == "provenance"


def owns_anything(run: Run, source: str) -> bool:
    """Whether any voxel or object is of a source."""
    joint = run.maps.joint
    for floor in joint.floors:
        sets = joint.source_sets(floor)
        if any(source in sets[number] for number in joint.layer(floor, "provenance")[1][:, 0]):
            return True
        if any(source in record.sources for record in joint.objects(floor)):
            return True
    return False


def test_a_log_that_cannot_be_replayed_is_said_and_the_maps_stay(run, monkeypatch):
    r = run()
    integrate(r, numbered(["robot/r", "camera/a", "robot/r"]))
    before = dump(r.maps.joint)
    monkeypatch.setattr(rebuild, "restore_snapshot", broken)
    ask(r, "camera/a")
    ended = finish(r)
    assert (ended.state, "made to fail" in ended.message) == ("failed", True)
    assert dump(r.maps.joint) == before
    monkeypatch.undo()
    r.close()
    r.start()
    assert dump(r.maps.joint) == before, "what failed isn't done behind anybody's back"
    ask(r, "camera/a")
    assert finish(r).state == "done"


def broken(*_: object) -> None:
    raise StoreError("corrupt", "made to fail")


@settings(max_examples=15, deadline=None)
@given(
    order=ORDERS,
    at=st.integers(0, 14),
    source=st.sampled_from(SOURCES),
    snapshot_views=st.sampled_from([2, 3, 1000]),
    restart=st.sampled_from(["never", "running", "done"]),
)
def test_maps_are_what_they_would_be_had_the_source_never_been_there(
    tmp_path_factory, tools, order, at, source, snapshot_views, restart
):
    """For every interleaving of two cameras and a robot, whenever it is asked for and whenever fusion is started again."""
    script, path = numbered(order), tmp_path_factory.mktemp("store") / "fusion.sqlite"
    before, after = script[:at], script[at:]
    if source not in {s for s, _ in before}:
        before = [*before, (source, at + 100)]
    run = Run(path, tools, snapshot_views=snapshot_views)
    try:
        for view in before:
            integrate(run, [view])
            run.log._snapshots.wait()
        begun = ask(run, source)
        assert (begun.way, begun.number) == ("replay", len(before))
        half = len(after) // 2
        integrate(run, after[:half])
        if restart == "running":
            run.close()
            run.start()
        finish(run)
        integrate(run, after[half:])
        if restart == "done":
            run.close()
            run.start()
        expected = clean(tools, [(s, n) for s, n in before if s != source] + after)
        assert_same(run, expected)
        assert run.maps.removals == 1
        robot = [n for s, n in before + after if s == "robot/r"]
        assert [r.seq for r in run.maps.processed.robots.values()] == robot[-1:], (
            "no mission waits for what was processed"
        )
        objects_and_histories(run, expected)
        run.close()
        run.start()  # and they stay so
        assert_same(run, expected)
    finally:
        run.close()


# --- cameras that aren't believed any more ------------------------------------------------------------------------

SCRIPT = numbered(["robot/r", "camera/a", "robot/r", "camera/b", "camera/a", "robot/r"])


def disbelieve(run: Run, source: str) -> None:
    run.maps.joint.quarantine.record_agreement({source: Agreement(9_000, 10)})


def test_what_a_camera_in_quarantine_has_contributed_is_removed_by_itself(run, tools):
    r = run(snapshot_views=3)
    integrate(r, SCRIPT)
    r.log.integrate([])
    assert r.log.removals.known == []
    disbelieve(r, "camera/a")
    r.log.integrate([])
    ended = finish(r)
    assert (ended.state, ended.source, ended.way) == ("done", "camera/a", "replay")
    assert "others look through" in ended.message
    for _ in range(2):
        assert "camera/a" in r.maps.joint.quarantine.reasons(), "it stays in quarantine"
        others = r.maps.joint.quarantine.state_of("camera/a")
        r.maps.joint.quarantine.forget("camera/a")
        assert_same(r, clean(tools, [view for view in SCRIPT if view[0] != "camera/a"]))
        r.maps.joint.quarantine.adopt("camera/a", others)
        r.log.integrate([])
        assert len(r.log.removals.known) == 1, "once is enough"
        r.close()
        r.start()


def test_a_restart_while_it_is_removed_keeps_it_in_quarantine(run, monkeypatch):
    r = run(snapshot_views=100)
    integrate(r, SCRIPT)
    disbelieve(r, "camera/a")
    with monkeypatch.context() as m:
        m.setattr(MapRebuild, "is_complete", lambda self: False)
        r.log.integrate([])
        assert r.log.removals.known[-1].state == "running"
        r.close()
    r.start()
    r.log.integrate([])
    assert r.log.removals.known[-1].state == "done"
    assert "camera/a" in r.maps.joint.quarantine.reasons()
    assert not owns_anything(r, "camera/a")


def test_without_a_file_it_is_removed_by_provenance(run):
    r = run(store="")
    integrate(r, SCRIPT)
    disbelieve(r, "camera/a")
    r.log.integrate([])
    assert (r.log.removals.known[-1].state, r.log.removals.known[-1].way) == ("done", "provenance")
    assert "camera/a" in r.maps.joint.quarantine.reasons()
    assert not owns_anything(r, "camera/a")


def test_whoever_has_a_camera_removed_has_it_believed_again(run):
    r = run(store="")
    integrate(r, SCRIPT)
    disbelieve(r, "camera/a")
    ask(r, "camera/a")
    assert "camera/a" not in r.maps.joint.quarantine.reasons()
