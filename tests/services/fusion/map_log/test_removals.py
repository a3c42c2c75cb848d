"""Taking a source's contribution out of the maps: they are what they would be had it never been there."""

from __future__ import annotations

import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from surveilnav.bus import Refused
from surveilnav.services.fusion.core.snapshot import dump
from surveilnav.services.fusion.map_log.removal import Removal
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


@settings(max_examples=25, deadline=None)
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
        objects_and_histories(run, expected)
        run.close()
        run.start()  # and they stay so
        assert_same(run, expected)
    finally:
        run.close()
