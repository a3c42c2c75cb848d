"""Which perception worker is asked first, and for how long."""

from __future__ import annotations

import pytest

from surveilnav.messages import WorkerLoad
from surveilnav.services.fusion.core.views.worker_selector import WorkerSelector


def load(worker: str, *, queued: int = 0, latency_ms: float = 100.0, ready: bool = True) -> WorkerLoad:
    return WorkerLoad(
        stamp_ns=1, worker=worker, backend="b", why="", queued=queued, capacity=4, latency_ms=latency_ms, ready=ready
    )


def ranked(selector: WorkerSelector, *loads: WorkerLoad, now_s: float = 0.0) -> list[str]:
    return [w.worker for w in selector.rank(loads, now_s)]


def test_the_least_loaded_goes_first_then_the_fastest_then_by_name() -> None:
    loads = load("d"), load("c", queued=2), load("b", latency_ms=50), load("a")
    assert ranked(WorkerSelector(), *loads) == ["b", "a", "d", "c"]


def test_who_is_not_ready_or_cannot_be_is_left_out() -> None:
    assert (
        ranked(WorkerSelector(), load("a", ready=False), load("b", queued=-1), load("c", latency_ms=float("nan"))) == []
    )


def test_what_was_asked_from_here_counts_before_the_load_says_so() -> None:
    selector = WorkerSelector()
    selector.record_request("a")
    assert ranked(selector, load("a"), load("b")) == ["b", "a"]
    selector.record_end("a", answered=True)
    assert ranked(selector, load("a"), load("b")) == ["a", "b"]


def test_who_stays_silent_comes_last_until_it_answers_or_long_enough() -> None:
    selector = WorkerSelector()
    selector.record_request("a")
    selector.record_late("a", 100.0)
    selector.record_end("a", answered=False)
    loads = load("a"), load("b", queued=50)
    assert ranked(selector, *loads, now_s=120.0) == ["b", "a"]
    assert ranked(selector, *loads, now_s=131.0) == ["a", "b"]
    selector.record_late("a", 140.0)
    selector.record_request("a")
    selector.record_end("a", answered=True)
    assert ranked(selector, *loads, now_s=141.0) == ["a", "b"]


@pytest.mark.parametrize(
    ("queued", "latency_ms", "expected_s"),
    [(0, 10.0, 0.5), (0, 300.0, 1.2), (3, 300.0, 4.8), (9, 900.0, 7.5), (0, 0.0, 7.5)],
)
def test_patience_goes_by_the_worker_and_ends_with_a_share_of_the_time_out(
    queued: int, latency_ms: float, expected_s: float
) -> None:
    patience_s = WorkerSelector().patience_s(load("a", queued=queued, latency_ms=latency_ms), 30.0)
    assert patience_s == pytest.approx(expected_s)
