"""The server's semantics over real Zenoh: batches, priority, bad pictures, memory, readiness, load."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np
import pytest

from surveilnav.bus import Answer, Refused
from surveilnav.bus.handover import HandoverFolder
from surveilnav.cli.stack import environment
from surveilnav.contract import PERCEPTION_LOAD, PERCEPTION_TEXT, TRUTH
from surveilnav.errors import PerceptionError
from surveilnav.histogram import quantile_ms
from surveilnav.messages import InferRequest, Truth
from surveilnav.sensing.packing import pack_array
from surveilnav.services.perception import __main__ as main
from surveilnav.simulator.truth.backends import Oracle
from surveilnav.storage import write_parts
from tests.waiting import until


def submit_in_order(pool, worker, requests):
    """Asks one after the other, so that they wait decoded in this order, and doesn't wait for answers."""

    def taken_in():
        load = worker.service.load()
        return load.queued, sum(load.times.get("decode", ()))

    queued, decoded = taken_in()
    futures = []
    for i, asked in enumerate(requests, start=1):
        futures.append(pool.submit(worker.ask, asked))
        until(lambda i=i: taken_in() == (queued + i, decoded + i))
    return futures


def test_what_waits_when_a_stage_falls_free_is_one_batch(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, max_batch=3)
    backend.let["detect"].clear()
    with ThreadPoolExecutor(6) as pool:
        first = submit_in_order(pool, worker, [request_of(10)])
        until(lambda: bool(backend.batches["detect"]))
        others = submit_in_order(pool, worker, [request_of(shade) for shade in (20, 30, 40, 50)])
        backend.let["detect"].set()
        for answer in (*first, *others):
            assert answer.result().detections[0].label == "chair"
    assert backend.batches["detect"][0] == [10], "a free stage waits for nobody"
    assert [len(b) for b in backend.batches["detect"]] == [1, 3, 1]


def test_the_detector_goes_on_while_the_embedder_is_stuck(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, max_batch=1)
    backend.let["embed"].clear()
    with ThreadPoolExecutor(3) as pool:
        answers = [pool.submit(worker.ask, request_of(shade)) for shade in (10, 20, 30)]
        until(lambda: len(backend.batches["detect"]) == 3)
        assert len(backend.batches["embed"]) == 1
        backend.let["embed"].set()
        assert [a.result().view for a in answers] == [10, 20, 30]


def test_a_robot_goes_before_cameras(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, max_batch=1, decoders=1)
    backend.let["detect"].clear()
    asked = [(10, "camera/a"), (20, "camera/b"), (30, "camera/c"), (40, "robot/r")]
    with ThreadPoolExecutor(4) as pool:
        answers = submit_in_order(pool, worker, [request_of(asked[0][0], asked[0][1])])
        until(lambda: bool(backend.batches["detect"]))
        answers += submit_in_order(pool, worker, [request_of(*a) for a in asked[1:]])
        until(lambda: sum(worker.service.load().times["decode"]) == 4)
        backend.let["detect"].set()
        for answer in answers:
            answer.result()
    assert backend.batches["detect"] == [[10], [40], [20], [30]]


def test_one_bad_picture_in_a_batch_fails_alone(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, max_batch=4)
    backend.let["detect"].clear()
    backend.bad = {30}
    with ThreadPoolExecutor(4) as pool:
        answers = submit_in_order(pool, worker, [request_of(10)])
        until(lambda: bool(backend.batches["detect"]))
        answers += submit_in_order(pool, worker, [request_of(shade) for shade in (20, 30, 40)])
        until(lambda: sum(worker.service.load().times["decode"]) == 4)
        backend.let["detect"].set()
        assert [answers[i].result().view for i in (0, 1, 3)] == [10, 20, 40]
        with pytest.raises(Refused, match="a bad picture") as error:
            answers[2].result()
    assert error.value.name == "perception_failed"
    assert worker.service.load().queued == 0


def test_of_many_that_ask_at_once_each_is_answered_or_told_when_to_come_again(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, capacity=4)
    backend.let["detect"].clear()

    def outcome(shade: int) -> str:
        try:
            return f"answered {worker.ask(request_of(shade)).view}"
        except Refused as error:
            return f"{error.name} {bool(error.retry_after_ms)}"

    with ThreadPoolExecutor(30) as pool:
        told = [pool.submit(outcome, shade) for shade in range(30)]
        until(lambda: sum(t.done() for t in told) == 26)
        assert {t.result() for t in told if t.done()} == {"busy True"}
        backend.let["detect"].set()
        assert sum(t.result() == f"answered {shade}" for shade, t in enumerate(told)) == 4


def test_who_is_refused_before_a_worker_could_read_the_request_is_told_when_to_come_again(
    make_worker, scripted, request_of
):
    backend = scripted()
    worker = make_worker(backend)
    backend.let["embed"].clear()

    def texts(n: int):
        try:
            return worker.ask((InferRequest(stamp_ns=1, texts=["t" * n]), b""), PERCEPTION_TEXT)
        except Refused as error:
            return error

    with ThreadPoolExecutor(30) as pool:
        view = pool.submit(worker.ask, request_of(10))
        until(lambda: bool(backend.batches["embed"]))
        asked = [pool.submit(texts, n) for n in range(1, 25)]  # one is worked on, 16 wait
        until(lambda: sum(a.done() for a in asked) == 24 - 17)
        refused = [a.result() for a in asked if a.done()]
        backend.let["embed"].set()
        view.result()
    assert {error.name for error in refused} == {"busy"}
    assert all(error.retry_after_ms for error in refused)


def test_a_newer_view_takes_the_place_of_one_that_waits(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, max_batch=1)
    backend.let["detect"].clear()
    with ThreadPoolExecutor(4) as pool:
        submit_in_order(pool, worker, [request_of(10)])
        until(lambda: bool(backend.batches["detect"]))
        (old,) = submit_in_order(pool, worker, [request_of(20, view=5, seq=1, asker="fusion")])
        (other,) = submit_in_order(pool, worker, [request_of(30, view=5, seq=1, asker="somebody else")])
        new = pool.submit(worker.ask, request_of(40, view=5, seq=2, asker="fusion"))
        with pytest.raises(Refused) as error:
            old.result()
        backend.let["detect"].set()
        assert new.result().seq == 2
        assert other.result().seq == 1
    assert error.value.name == "superseded"


def test_a_view_of_no_use_any_more_is_dropped_if_it_waits(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, max_batch=1)
    backend.let["detect"].clear()

    def cancel(stamp_ns, **changes):
        return InferRequest(stamp_ns=stamp_ns, source="robot/r", view=5, seq=1, cancel=True, **changes), b""

    with ThreadPoolExecutor(4) as pool:
        submit_in_order(pool, worker, [request_of(10)])
        until(lambda: bool(backend.batches["detect"]))
        asked = [(20, 7, "fusion"), (30, 7, "somebody else"), (40, 8, "a third")]
        loser, other, newer = submit_in_order(
            pool, worker, [request_of(shade, view=5, stamp_ns=at, asker=asker) for shade, at, asker in asked]
        )
        worker.ask(cancel(7, asker="a third"))  # it has asked again since
        told = worker.ask(cancel(7, asker="fusion"))
        assert (told.detections, told.image_embedding) == ([], b"")
        with pytest.raises(Refused) as error:
            loser.result()
        with pytest.raises(Refused, match="name the asker"):
            worker.ask(cancel(7))
        assert worker.service.load().queued == 3
        backend.let["detect"].set()
        assert (other.result().view, newer.result().view) == (5, 5)
    assert error.value.name == "cancelled"
    assert backend.batches["detect"] == [[10], [30], [40]]


def test_the_same_picture_is_looked_at_once(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend)
    first = worker.ask(request_of(10, prompts=["tv"]))
    again = worker.ask(request_of(10, prompts=["tv"], source="camera/c", view=3, seq=8))
    assert backend.batches["detect"] == [[10]]
    assert (again.source, again.view, again.seq) == ("camera/c", 3, 8)
    assert (again.detections, again.relevance) == (first.detections, first.relevance)
    worker.ask(request_of(20, prompts=["tv"]))
    assert backend.batches["detect"] == [[10], [20]]
    assert worker.service.load().cached == 1


@pytest.mark.parametrize(("needs_prompts", "looks"), [(False, [[10]]), (True, [[10], [10]])])
def test_other_prompts_need_another_look_only_where_they_are_what_is_found(
    make_worker, scripted, request_of, needs_prompts, looks
):
    backend = scripted(needs_prompts=needs_prompts)
    worker = make_worker(backend)
    worker.ask(request_of(10, prompts=["tv"]))
    other = worker.ask(request_of(10, prompts=["bed", "sofa"]))
    assert backend.batches["detect"] == looks
    assert other.relevance == {"bed": 0.0, "sofa": pytest.approx(0.6)}, "of these prompts, not of those before"


@pytest.mark.parametrize(
    ("source", "settings", "looks"),
    [
        ("camera/c", {"simulated": True}, [[10]]),
        ("robot/r", {"simulated": True}, [[10], [10]]),
        ("camera/c", {"simulated": False}, [[10], [10]]),
        ("camera/c", {"simulated": True, "disk_cache_mb": 0}, [[10], [10]]),
    ],
)
def test_a_simulated_camera_view_is_looked_at_in_one_run_alone(
    make_worker, scripted, request_of, tmp_path, monkeypatch, source, settings, looks
):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    backend = scripted()
    first, second = (make_worker(backend, **settings).ask(request_of(10, source=source)) for _ in range(2))
    assert backend.batches["detect"] == looks
    assert first.detections == second.detections


def test_a_kept_answer_that_means_nothing_any_more_is_given_anew(
    make_worker, scripted, request_of, tmp_path, monkeypatch
):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    backend = scripted()
    first = make_worker(backend, simulated=True).ask(request_of(10, source="camera/c"))
    (file,) = tmp_path.rglob("answers/*/*.kept")
    write_parts(file, b"surveilnav answer 1", [b"an answer of another version"])
    for _ in range(2):
        again = make_worker(backend, simulated=True).ask(request_of(10, source="camera/c"))
        assert again.detections == first.detections
    assert backend.batches["detect"] == [[10], [10]], "given anew once, and kept"


def test_a_known_view_with_a_new_prompt_waits_for_the_backend_and_holds_up_nobody(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, max_batch=1)
    worker.ask(request_of(10, prompts=["tv"]))
    backend.let["embed"].clear()
    with ThreadPoolExecutor(3) as pool:
        busy = pool.submit(worker.ask, request_of(20))
        until(lambda: backend.batches["embed"][-1:] == [[20]])
        new = pool.submit(worker.ask, request_of(10, prompts=["a new word"]))
        assert worker.ask(request_of(10, prompts=["tv"])).relevance
        assert not new.done()
        backend.let["embed"].set()
        assert new.result().relevance
        busy.result()


def test_a_worker_of_other_settings_looks_itself(make_worker, scripted, request_of, tmp_path, monkeypatch):
    monkeypatch.setenv("SURVEILNAV_CACHE_DIR", str(tmp_path))
    backend = scripted()
    for threshold in (0.1, 0.2):
        make_worker(backend, simulated=True, threshold=threshold).ask(request_of(10, source="camera/c"))
    assert backend.batches["detect"] == [[10], [10]]


def test_what_is_told_the_truth_is_not_remembered(make_worker, request_of, client):
    worker, boxes = make_worker(Oracle()), []

    def answer(asked):
        seq = int(asked.parameters["seq"])
        ids = np.zeros((48, 64), np.uint16)
        ids[10:30, 20 * seq : 20 * seq + 20] = 5
        told = Truth(stamp_ns=1, source="robot/r", view=10, seq=seq, width_px=64, height_px=48, labels={5: "bed"})
        return Answer(told, pack_array(ids))

    client.serve(TRUTH, answer, source="robot-r", view=10)
    for seq in (1, 2):
        boxes.append(worker.ask(request_of(10, seq=seq)).detections[0].box_px)
    assert boxes == [(20.0, 10.0, 40.0, 30.0), (40.0, 10.0, 60.0, 30.0)]


def test_the_last_stage_and_texts_take_turns(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend)
    backend.let["embed"].clear()
    with ThreadPoolExecutor(2) as pool:
        view = pool.submit(worker.ask, request_of(10))
        until(lambda: bool(backend.batches["embed"]))
        text = pool.submit(worker.ask, (InferRequest(stamp_ns=1, texts=["abcd"]), b""), PERCEPTION_TEXT)
        with pytest.raises(TimeoutError):
            text.result(timeout=0.5)
        assert "abcd" not in backend.texts
        backend.let["embed"].set()
        assert len(text.result().embeddings) == 1
        assert view.result().view == 10


def test_answers_say_models_and_how_relevant_the_view_is_to_each_prompt(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend)
    asked = request_of(10, prompts=["abcd", "abcde", "ab", "flux capacitor"])
    reply = worker.ask(asked)
    assert reply.models == backend.models
    assert reply.relevance == pytest.approx({"abcd": 0.6, "abcde": 0.8, "ab": 0.0})
    worker.ask(request_of(20, prompts=["abcd", "abcde"]))
    assert backend.texts.count("abcd") == 1, "a text is embedded once"
    worker.ask(request_of(30, prompts=["x", "xy", "xyz", "ab"]))
    assert backend.text_batches[-1] == 3, "new texts are embedded in one batch"


def test_who_wants_only_the_embedding_keeps_no_detector_busy(make_worker, scripted, request_of):
    backend = scripted(needs_prompts=True)
    worker = make_worker(backend)
    reply = worker.ask(request_of(10, detects=False))
    assert (reply.detections, len(reply.image_embedding)) == ([], 8)
    assert (backend.batches["detect"], backend.batches["embed"]) == ([], [[10]])
    closed = scripted()
    assert make_worker(closed).ask(request_of(10, detects=False)).detections == []
    assert closed.batches["detect"] == [[10]], "the embedding of a closed set depends on what is found"


def test_a_worker_is_ready_when_it_answered_a_probe_rightly(make_worker, scripted, request_of):
    backend = scripted()
    worker = make_worker(backend, warm=False)
    assert not worker.ask((None, b""), PERCEPTION_LOAD).ready
    with pytest.raises(Refused) as error:
        worker.ask(request_of(10))
    assert error.value.name == "not_ready"
    assert error.value.retry_after_ms
    with pytest.raises(Refused) as error:  # the backend serves one thread at a time, and that warms it up
        worker.ask((InferRequest(stamp_ns=1, texts=["abcd"]), b""), PERCEPTION_TEXT)
    assert error.value.name == "not_ready"
    assert backend.texts == []
    worker.service.warm_up()
    assert worker.ask((None, b""), PERCEPTION_LOAD).ready
    assert worker.ask(request_of(10)).view == 10


@pytest.mark.parametrize(
    "changes",
    [
        {"embedding": np.array([np.nan, 0, 0, 0], np.float32)},
        {"embedding": np.array([3, 0, 0, 0], np.float32)},
        {"embedding": np.array([1, 0, 0], np.float32)},
        {"box_px": (4.0, 4.0, 2000.0, 20.0)},
        {"box_px": (20.0, 4.0, 4.0, 20.0)},
        {"box_px": (float("nan"), 4.0, 4.0, 20.0)},
    ],
)
def test_a_worker_that_answers_nonsense_is_never_ready(make_worker, scripted, changes):
    backend = scripted()
    for name, value in changes.items():
        setattr(backend, name, value)
    worker = make_worker(backend, warm=False)
    with pytest.raises(PerceptionError, match="probe"):
        worker.service.warm_up()
    assert not worker.service.ready


def test_a_process_that_is_never_ready_ends_and_says_why(scripted, bus, monkeypatch):
    broken = scripted()
    broken.embedding = np.zeros(4, np.float32)
    monkeypatch.setattr(main, "choose_backend", lambda *_, **__: broken)
    monkeypatch.setenv("SURVEILNAV_BUS__ROUTER", bus.router)
    with ThreadPoolExecutor(1) as pool, pytest.raises(PerceptionError, match="probe picture rightly: expected a unit"):
        pool.submit(main.main).result(timeout=20)


@pytest.mark.parametrize("simulated", [True, False])
def test_a_worker_is_told_whether_its_building_is_simulated(monkeypatch, simulated):
    told = []

    def chosen(name, **settings):
        told.append((name, settings["simulated"]))
        raise PerceptionError("enough")

    monkeypatch.setattr(main, "choose_backend", chosen)
    if simulated:
        stack = environment(
            router="tcp/127.0.0.1:1",
            building="b",
            seed=0,
            cameras=None,
            area_per_camera_m2=1.0,
            perception="auto",
            surveillance=True,
            state=Path(),
        )
        monkeypatch.setenv("SURVEILNAV_PERCEPTION__SIMULATED", stack["SURVEILNAV_PERCEPTION__SIMULATED"])
    with pytest.raises(PerceptionError, match="enough"):
        main.main()
    assert told == [("auto", simulated)]


def test_the_load_says_how_long_each_stage_takes(make_worker, scripted, request_of):
    worker = make_worker(scripted())
    for shade in (10, 20, 30):
        worker.ask(request_of(shade))
    load = worker.ask((None, b""), PERCEPTION_LOAD)
    assert list(load.times) == ["queue", "decode", "detect", "embed", "answer"]
    assert {stage: sum(counts) for stage, counts in load.times.items()} == dict.fromkeys(load.times, 3)
    assert all(quantile_ms(counts, 0.95) is not None for counts in load.times.values())
    assert load.models == worker.service.load().models


def test_texts_are_embedded_once_and_the_space_is_named(make_worker, scripted):
    backend = scripted()
    worker = make_worker(backend)
    for _ in range(3):
        reply = worker.ask((InferRequest(stamp_ns=1, texts=["abcd", "abc"]), b""), PERCEPTION_TEXT)
    assert len(reply.embeddings) == 2
    assert reply.models.embedder == "e@1"
    assert backend.texts.count("abcd") == 1


def test_a_picture_in_the_shared_folder_is_as_good_as_one_that_is_sent(make_worker, scripted, request_of, tmp_path):
    share = HandoverFolder(tmp_path, 1 << 20)
    worker = make_worker(scripted(), folder=tmp_path)
    assert worker.service.load().handover == share.token
    asked, picture = request_of(10)
    handed = msgspec.structs.replace(asked, handed=share.put(picture))
    assert worker.ask((handed, b"")).detections == worker.ask((asked, picture)).detections
    for name in ("0" * 32, "../token", "token"):
        with pytest.raises(Refused, match="send it") as refused:
            worker.ask((msgspec.structs.replace(asked, handed=name), b""))
        assert refused.value.name == "not_handed"
