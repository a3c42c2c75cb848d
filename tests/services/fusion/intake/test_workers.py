"""Several perception workers over real Zenoh: one that hangs delays nobody whom another can serve."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import msgspec
import pytest

from surveilnav import contract
from surveilnav.bus import Answer, BusSettings, Node, Refused, Unanswered, clock_ns
from surveilnav.bus.handover import HandoverFolder
from surveilnav.bus.router import free_port, open_router
from surveilnav.errors import PerceptionError
from surveilnav.messages import InferReply, InferRequest, WorkerLoad
from surveilnav.services.fusion.intake.workers import Workers
from tests.waiting import until

ASKED = InferRequest(stamp_ns=1, source="robot/r", view=0, seq=1)


class FakeWorker:
    """Says that it is idle and fast; answers as ``behave`` says."""

    def __init__(
        self, bus: BusSettings, name: str, behave: Callable[[], object], *, ready: bool = True, share: str = ""
    ) -> None:
        self.name, self.behave, self.ready, self.share, self.asked = name, behave, ready, share, 0
        self.payloads: list[bytes] = []
        self.requests: list[InferRequest] = []
        self.node = Node("perception", name, bus).__enter__()
        self._load = self.node.publisher(contract.PERCEPTION_LOAD, worker=name)
        self.node.serve(contract.PERCEPTION_INFER, self._infer, worker=name)
        threading.Thread(target=self._say, daemon=True).start()

    def _say(self) -> None:
        while not self.node.stopping.wait(0.05):
            self._load.put(
                WorkerLoad(
                    stamp_ns=clock_ns(),
                    worker=self.name,
                    backend="b",
                    why="",
                    queued=0,
                    capacity=4,
                    latency_ms=1.0,
                    ready=self.ready,
                    handover=self.share,
                )
            )

    def _infer(self, request):
        self.requests.append(request.message)
        self.payloads.append(request.payload)
        if request.message.cancel:
            return Answer(reply_of(self.name))
        self.asked += 1
        outcome = self.behave()
        if isinstance(outcome, Exception):
            raise outcome
        if isinstance(outcome, Future):
            return outcome
        m = request.message
        return Answer(
            InferReply(
                stamp_ns=1,
                worker=self.name,
                backend="b",
                source=m.source,
                view=m.view,
                seq=m.seq,
                detections=[],
                image_embedding=b"",
            )
        )


@pytest.fixture(scope="module")
def bus() -> Iterator[BusSettings]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint):
        yield BusSettings(router=endpoint, building="b")


@pytest.fixture
def make_worker(bus: BusSettings) -> Iterator[Callable[..., FakeWorker]]:
    made: list[FakeWorker] = []

    def make(name: str, behave: Callable[[], object] = lambda: None, **options: Any) -> FakeWorker:
        made.append(FakeWorker(bus, name, behave, **options))
        return made[-1]

    yield make
    for worker in made:
        worker.node.__exit__(None, None, None)


@pytest.fixture
def workers(bus: BusSettings) -> Iterator[Callable[[int], Workers]]:
    """Waits until it sees so many workers that are ready."""
    with Node("fusion", "f", bus, alive=False) as node:
        seen = Workers(node)

        def wait(n: int) -> Workers:
            if not n:
                return seen
            until_s = time.monotonic() + 10
            while time.monotonic() < until_s:
                try:
                    if len(seen.ranked()) >= n:
                        return seen
                except PerceptionError:
                    pass
                time.sleep(0.02)
            raise AssertionError(f"never saw {n} workers")

        yield wait


def ask(workers: Workers, timeout_s: float = 20.0, request: InferRequest = ASKED) -> str:
    return workers.ask(contract.PERCEPTION_INFER, request, timeout_s=timeout_s).message.worker


def test_a_frozen_worker_delays_nobody_whom_another_can_serve(make_worker, workers) -> None:
    frozen, good = make_worker("a", Future), make_worker("b")
    seen = workers(2)
    assert seen.ranked()[0].worker == "a", "the test means the one that is asked first"
    assert ask(seen) == "b"
    assert any(t.name == "ask-a" for t in threading.enumerate()), "the frozen one's time wasn't over when b was asked"
    assert [ask(seen) for _ in range(4)] == ["b"] * 4
    assert (frozen.asked, good.asked) == (1, 5), "who stays silent isn't asked again soon"


def test_an_answer_that_comes_late_still_counts_and_clears_the_name(make_worker, workers) -> None:
    late: Future = Future()
    make_worker("a", lambda: late)
    make_worker("b", lambda: Future())
    seen = workers(2)
    threading.Timer(1.5, lambda: late.set_result(Answer(reply_of("a")))).start()
    assert ask(seen) == "a"
    assert seen.ranked()[0].worker == "a"


def reply_of(worker: str) -> InferReply:
    return InferReply(
        stamp_ns=1, worker=worker, backend="b", source="robot/r", view=0, seq=1, detections=[], image_embedding=b""
    )


def test_a_busy_worker_sends_on_to_the_next_and_another_refusal_does_not(make_worker, workers) -> None:
    busy, good = make_worker("a", lambda: Refused("busy", "later", 50)), make_worker("b")
    seen = workers(2)
    assert ask(seen) == "b"
    assert (busy.asked, good.asked) == (1, 1)
    busy.behave = lambda: Refused("bad_prompt", "no dots")
    with pytest.raises(Refused, match="dots"):
        ask(seen)
    busy.behave = good.behave = lambda: Refused("busy", "later", 50)
    with pytest.raises(Refused) as error:
        ask(seen)
    assert error.value.retry_after_ms == 50


def test_who_is_not_ready_is_not_asked(make_worker, workers) -> None:
    cold = make_worker("a", ready=False)
    make_worker("b")
    seen = workers(1)
    assert [ask(seen) for _ in range(3)] == ["b"] * 3
    assert cold.asked == 0


def test_alone_a_frozen_worker_is_waited_for_until_the_time_is_over(make_worker, workers) -> None:
    make_worker("a", Future)
    with pytest.raises(Unanswered):
        ask(workers(1), timeout_s=0.5)


def test_without_workers_it_says_so(workers) -> None:
    with pytest.raises(PerceptionError, match="no worker"):
        ask(workers(0))


def test_who_is_asked_later_is_told_how_much_time_is_left(make_worker, workers) -> None:
    frozen, good = make_worker("a", Future), make_worker("b")
    ask(workers(2), timeout_s=8.0)
    (first,), (second,) = [r.deadline_ms for r in frozen.requests], [r.deadline_ms for r in good.requests]
    assert 7000 < first <= 7200, "a part of the time is for the answer's way"
    assert second < first - 400, "the first was waited for half a second at least"


def test_a_deadline_of_its_own_is_kept(make_worker, workers) -> None:
    good = make_worker("a")
    ask(workers(1), request=msgspec.structs.replace(ASKED, deadline_ms=300))
    assert [r.deadline_ms for r in good.requests] == [300]


def test_who_is_too_late_is_told_and_who_answered_is_not(make_worker, workers) -> None:
    loser: Future = Future()
    late, good = make_worker("a", lambda: loser), make_worker("b")
    seen = workers(2)
    assert ask(seen, request=msgspec.structs.replace(ASKED, asker="f")) == "b"
    until(lambda: any(r.cancel for r in late.requests))
    told = late.requests[-1]
    assert (told.asker, told.source, told.view, told.stamp_ns) == ("f", ASKED.source, ASKED.view, ASKED.stamp_ns)
    assert not any(r.cancel for r in good.requests)
    loser.set_exception(Refused("cancelled", "dropped"))
    until(lambda: not any(t.name == "ask-a" for t in threading.enumerate()))
    assert seen.ranked()[0].worker == "b", "that it heard of a cancel doesn't make it any faster"


def test_who_has_no_name_cancels_nothing(make_worker, workers) -> None:
    late, _ = make_worker("a", Future), make_worker("b")
    ask(workers(2))
    assert not any(t.name.startswith("cancel") for t in threading.enumerate())
    assert [r.cancel for r in late.requests] == [False]


@pytest.mark.parametrize("shares", ["the folder", "another", "none"])
def test_a_worker_that_shares_the_folder_is_handed_the_picture(make_worker, workers, tmp_path, shares) -> None:
    share = HandoverFolder(tmp_path / "share", 1 << 20)
    other = HandoverFolder(tmp_path / "other", 1 << 20)
    worker = make_worker("a", share={"the folder": share.token, "another": other.token, "none": ""}[shares])
    seen = workers(1)
    seen._node.handover = share
    seen.ask(contract.PERCEPTION_INFER, ASKED, b"a picture", timeout_s=20)
    (asked,), (payload,) = worker.requests, worker.payloads
    if shares == "the folder":
        assert (share.get(asked.handed), payload) == (b"a picture", b"")
    else:
        assert (asked.handed, payload) == ("", b"a picture")


def test_a_picture_that_is_not_there_any_more_is_sent(make_worker, workers, tmp_path) -> None:
    share = HandoverFolder(tmp_path, 1 << 20)
    outcomes = iter([Refused("not_handed", "it isn't there"), None, Refused("bad_image", "no picture")])
    worker = make_worker("a", lambda: next(outcomes), share=share.token)
    seen = workers(1)
    seen._node.handover = share
    seen.ask(contract.PERCEPTION_INFER, ASKED, b"a picture", timeout_s=20)
    assert worker.payloads == [b"", b"a picture"]
    assert [bool(r.handed) for r in worker.requests] == [True, False]
    with pytest.raises(Refused, match="no picture"):
        seen.ask(contract.PERCEPTION_INFER, ASKED, b"a picture", timeout_s=20)
    assert len(worker.payloads) == 3, "what isn't about the folder isn't asked again"
