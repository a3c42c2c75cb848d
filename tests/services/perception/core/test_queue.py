"""Who waits, who goes first, who is refused away."""

from __future__ import annotations

from surveilnav.services.perception.core.queue import Job, RefusedJob, StageQueues

MS = 1_000_000
LATE = 10_000 * MS


def job(name: str, *, urgent: bool = False, deadline_ms: float = 10_000, replaces: str | None = None) -> Job[str]:
    return Job(name, urgent, int(deadline_ms * MS), replaces)


def queues(capacity: int = 4) -> StageQueues[str]:
    return StageQueues(("detect", "embed"), capacity)


def admit(q: StageQueues[str], *jobs: Job[str], now_ns: int = 0) -> list[RefusedJob[str]]:
    refused = []
    for j in jobs:
        out = q.admit(j, now_ns)
        refused += out
        if all(t.job is not j for t in out):
            q.enqueue(j, "detect", now_ns)
    return refused


def names(refused: list[RefusedJob[str]]) -> list[tuple[str, str]]:
    return [(t.job.item, t.why.name) for t in refused]


def taken(q: StageQueues[str], max_batch: int = 9, stage: str = "detect", now_ns: int = 0) -> list[str]:
    return [j.item for j in q.next_batch(stage, max_batch, now_ns)[0]]


def test_robots_go_first_then_who_came_first() -> None:
    q = queues()
    admit(q, job("camera 1"), job("robot 1", urgent=True), job("camera 2"), job("robot 2", urgent=True))
    assert taken(q, 3) == ["robot 1", "robot 2", "camera 1"]
    assert taken(q) == ["camera 2"]
    assert taken(q) == []


def test_what_was_admitted_first_stays_first_at_every_stage() -> None:
    q = queues()
    first, second = job("first"), job("second")
    admit(q, first, second)
    q.next_batch("detect", 2, 0)
    q.enqueue(second, "embed", 0)
    q.enqueue(first, "embed", 0)
    assert taken(q, stage="embed") == ["first", "second"]


def test_a_full_worker_refuses_and_says_when_to_come_again() -> None:
    q = queues(2)
    refused = admit(q, job("a"), job("b"), job("c"))
    assert names(refused) == [("c", "busy")]
    assert (refused[0].why.retry_after_ms or 0) > 0
    assert q.in_progress == 2


def test_what_a_stage_works_on_counts_until_it_is_finished() -> None:
    q = queues(1)
    a = job("a")
    admit(q, a)
    q.next_batch("detect", 1, 0)
    assert names(admit(q, job("b"))) == [("b", "busy")]
    q.finish(a, 0)
    assert admit(q, job("c")) == []


def test_a_robot_takes_the_place_of_the_newest_camera_but_of_no_robot() -> None:
    q = queues(2)
    admit(q, job("camera 1"), job("camera 2"))
    assert names(admit(q, job("robot 1", urgent=True))) == [("camera 2", "busy")]
    assert names(admit(q, job("robot 2", urgent=True))) == [("camera 1", "busy")]
    assert names(admit(q, job("robot 3", urgent=True))) == [("robot 3", "busy")]
    assert q.in_progress == 2


def test_a_deadline_in_the_past_is_refused_at_once() -> None:
    q = queues()
    assert names(admit(q, job("a", deadline_ms=5), now_ns=5 * MS)) == [("a", "too_late")]
    assert q.in_progress == 0


def test_deadlines_are_kept_at_every_stage() -> None:
    q = queues()
    a, b, c = job("a", deadline_ms=5), job("b"), job("c", deadline_ms=8)
    admit(q, a, b, c)
    batch, late = q.next_batch("detect", 9, 6 * MS)
    assert [j.item for j in batch] == ["b", "c"]
    assert names(late) == [("a", "too_late")]
    for j in batch:
        q.enqueue(j, "embed", 7 * MS)
    assert names(q.expire(9 * MS)) == [("c", "too_late")]
    assert taken(q, stage="embed", now_ns=9 * MS) == ["b"]
    assert q.in_progress == 1


def test_a_newer_request_supersedes_what_waits_at_any_stage_but_not_what_runs() -> None:
    q = queues()
    runs, waits, later = job("runs", replaces="v"), job("waits", replaces="v"), job("other", replaces="w")
    admit(q, runs)
    q.next_batch("detect", 1, 0)
    admit(q, waits, later)
    q.next_batch("detect", 1, 0)
    q.enqueue(waits, "embed", 0)
    assert names(admit(q, job("new", replaces="v"))) == [("waits", "superseded")]
    assert q.in_progress == 3
    assert names(admit(q, job("nobody's"), job("nobody's"))) == [("nobody's", "busy")]


def test_the_time_of_waiting_adds_up_over_stages() -> None:
    q = queues()
    a = job("a")
    admit(q, a)
    q.next_batch("detect", 1, 3 * MS)
    q.enqueue(a, "embed", 10 * MS)
    q.next_batch("embed", 1, 14 * MS)
    assert a.waited_ns == 7 * MS


def test_who_comes_again_is_told_the_pace_of_the_last_answers() -> None:
    def retry_ms(pace_ms: int) -> int:
        q = queues(4)
        for i in range(60):
            j = job("a", deadline_ms=1e9)
            admit(q, j, now_ns=i * pace_ms * MS)
            q.next_batch("detect", 1, i * pace_ms * MS)
            q.enqueue(j, "embed", (i + 1) * pace_ms * MS - 1)  # the last stage is the shortest
            q.next_batch("embed", 1, (i + 1) * pace_ms * MS)
            q.finish(j, (i + 1) * pace_ms * MS)
        admit(q, *(job(str(i), deadline_ms=1e9) for i in range(4)), now_ns=60 * pace_ms * MS)
        return q.retry_after_ms()

    assert 35 <= retry_ms(20) <= 45  # half of four views, 20 ms each
    assert 350 <= retry_ms(200) <= 450


def test_what_is_cancelled_goes_from_every_stage_and_makes_room() -> None:
    q = queues(3)
    admit(q, job("a"), job("b"), job("c"))
    (first,), _ = q.next_batch("detect", 1, 0)
    q.enqueue(first, "embed", 0)
    assert names(q.cancel(lambda item: item in ("a", "b"))) == [("b", "cancelled"), ("a", "cancelled")]
    assert q.in_progress == 1
    assert (taken(q), taken(q, stage="embed")) == (["c"], [])
    assert q.cancel(lambda item: item == "c") == [], "what is worked on goes on"
