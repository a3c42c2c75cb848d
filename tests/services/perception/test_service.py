"""The worker over real Zenoh."""

from __future__ import annotations

import gc
import math
import subprocess
import sys
import threading
import weakref
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from surveilnav.bus import Answer, BusSettings, Node, Refused, Request, clock_ns
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_LOAD, PERCEPTION_TEXT, TRUTH
from surveilnav.geometry import Pinhole
from surveilnav.messages import InferRequest, PayloadPart, Truth, WorkerLoad
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.sensing.packing import encode_rgbd, pack_array, unpack_embedding
from surveilnav.sensing.replies import perception_from_wire
from surveilnav.sensing.views import ViewPerception
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.embedding import EmbeddingStage
from surveilnav.services.perception.inference import InferenceHandler
from surveilnav.services.perception.service import PerceptionService
from surveilnav.simulator.truth.backends import Oracle, Simulated
from tests.waiting import until

CAMERA = Pinhole.from_hfov(64, 48, math.radians(79))
RANGE_M = (0.5, 5.0)


class Patient(Backend):
    """A backend that answers when it is let; its probe always."""

    name, why, embedding_dim = "patient", "for tests", 4

    def __init__(self) -> None:
        self.let = threading.Event()
        self.started = threading.Event()
        self.stages = (Stage("look", self._look),)

    def _look(self, batch: Sequence[ViewTask]) -> None:
        if batch[0].key != ("probe",):
            self.started.set()
            assert self.let.wait(10)
        for task in batch:
            task.result = ViewPerception(self.name, (), np.array([1, 0, 0, 0], np.float32))

    def embed_texts(self, texts: Sequence[str]) -> np.ndarray:
        return np.eye(4, dtype=np.float32)[[len(t) % 4 for t in texts]]


def serving(node: Node, backend: Backend, settings: PerceptionSettings) -> PerceptionService:
    service = PerceptionService(node, backend, settings)
    service.warm_up()
    return service


def request(seq: int = 1, shade: int = 0, **changes: object) -> tuple[InferRequest, bytes]:
    """About a picture all of one shade: another shade is another picture."""
    depth = np.full((48, 64), 2.0, np.float32)
    payload, image, depth_part = encode_rgbd(np.full((48, 64, 3), shade, np.uint8), depth, depth_range_m=RANGE_M)
    asked = InferRequest(
        stamp_ns=clock_ns(),
        source="robot/r",
        view=0,
        seq=seq,
        camera=CAMERA,
        image=image,
        depth=depth_part,
        depth_range_m=RANGE_M,
    )
    return msgspec.structs.replace(asked, **changes), payload


def tell_truth(node: Node, seq: int, told_seq: int | None = None) -> None:
    """Has a node tell what one view of robot r shows, as simulator nodes do; of ``told_seq``, if that is given."""
    ids = np.zeros((48, 64), np.uint16)
    ids[10:30, 20:50] = 5

    def answer(asked: Request) -> Answer:
        if asked.parameters != {"seq": str(seq)}:
            raise Refused("no_truth", "another view")
        message = Truth(
            stamp_ns=clock_ns(),
            source="robot/r",
            view=0,
            seq=seq if told_seq is None else told_seq,
            width_px=64,
            height_px=48,
            labels={5: "bed"},
        )
        return Answer(message, pack_array(ids))

    node.serve(TRUTH, answer, source="robot-r", view=0)


def test_oracle_asks_for_the_instance_ids_of_just_that_view(bus: BusSettings, client: Node) -> None:
    tell_truth(client, 7)
    with Node("perception", "w1", bus) as node:
        serving(node, Oracle(), PerceptionSettings(worker="w1"))
        asked, payload = request(seq=7)
        reply = client.ask(PERCEPTION_INFER, asked, payload=payload, worker="w1", timeout_s=10).message
        asked, payload = request(seq=6)
        with pytest.raises(Refused, match=r"no instance ids of robot/r view 0 seq 6.*another view") as error:
            client.ask(PERCEPTION_INFER, asked, payload=payload, worker="w1", timeout_s=10)
    assert error.value.name == "no_truth"
    assert (reply.worker, reply.backend, reply.source, reply.seq) == ("w1", "oracle", "robot/r", 7)
    seen = perception_from_wire(reply, CAMERA)
    assert [(d.label, d.box_px) for d in seen.detections] == [("bed", (20.0, 10.0, 50.0, 30.0))]


def test_instance_ids_of_another_view_are_no_answer(bus: BusSettings, client: Node) -> None:
    tell_truth(client, 7, told_seq=8)
    with Node("perception", "w4", bus) as node:
        serving(node, Oracle(), PerceptionSettings(worker="w4"))
        asked, payload = request(seq=7)
        with pytest.raises(Refused, match=r"expected the instance ids of robot/r view 0 seq 7, got .* seq 8") as error:
            client.ask(PERCEPTION_INFER, asked, payload=payload, worker="w4", timeout_s=10)
        assert error.value.name == "bad_message"
        for source in ("robot/r 1", "*"):
            asked, payload = request(seq=7, source=source)
            with pytest.raises(Refused) as error:
                client.ask(PERCEPTION_INFER, asked, payload=payload, worker="w4", timeout_s=10)
            assert error.value.name in ("no_truth", "bad_message")


def test_an_answered_request_is_freed_at_once() -> None:
    """A reference cycle would keep its pictures until the garbage collector comes."""
    node = SimpleNamespace(handover=None, stopping=threading.Event())
    handler = InferenceHandler(node, Oracle(), EmbeddingStage(Oracle()), PerceptionSettings(worker="w1"))  # type: ignore[arg-type]
    handler.pipeline.submit = lambda job: None  # type: ignore[method-assign]
    gc.disable()
    try:
        answer = handler.infer(*request(), clock_ns())
        freed = weakref.ref(answer)
        del answer
        assert freed() is None
    finally:
        gc.enable()
        node.stopping.set()


def test_where_nobody_tells_instance_ids_the_request_is_refused_by_name(bus: BusSettings, client: Node) -> None:
    with Node("perception", "w2", bus) as node:
        serving(node, Oracle(), PerceptionSettings(worker="w2"))
        asked, payload = request()
        with pytest.raises(Refused, match=r"instance ids.*nobody is there") as error:
            client.ask(PERCEPTION_INFER, asked, payload=payload, worker="w2", timeout_s=10)
    assert error.value.name == "no_truth"


def test_a_real_backend_never_asks_for_truth(bus: BusSettings, client: Node) -> None:
    questions: list[Request] = []

    def count(asked: Request) -> Answer:
        questions.append(asked)
        raise Refused("no_truth", "this is a test")

    client.serve(TRUTH, count, source="robot-r", view=0)
    asked, payload = request()
    for backend, n_questions in ((Patient(), 0), (Oracle(), 1)):
        with Node("perception", "w3", bus) as node:
            if isinstance(backend, Patient):
                backend.let.set()
            serving(node, backend, PerceptionSettings(worker="w3"))
            with nullcontext() if n_questions == 0 else pytest.raises(Refused, match="this is a test"):
                client.ask(PERCEPTION_INFER, asked, payload=payload, worker="w3", timeout_s=10)
        assert len(questions) == n_questions


def test_a_full_queue_refuses_and_a_deadline_is_kept_while_a_stage_is_stuck(bus: BusSettings, client: Node) -> None:
    backend = Patient()
    with Node("perception", "w5", bus) as node:
        service = serving(node, backend, PerceptionSettings(worker="w5", capacity=2, max_batch=1))

        def infer(message: InferRequest, payload: bytes) -> object:
            return client.ask(PERCEPTION_INFER, message, payload=payload, worker="w5", timeout_s=20)

        with ThreadPoolExecutor() as pool:
            first = pool.submit(infer, *request(shade=1))
            assert backend.started.wait(10)
            with pytest.raises(Refused) as late:
                infer(*request(shade=2, deadline_ms=100))
            second = pool.submit(infer, *request(shade=3))
            until(lambda: service.load().queued == 2)
            with pytest.raises(Refused) as busy:
                infer(*request(shade=4))
            backend.let.set()
            first.result(timeout=10)
            second.result(timeout=10)
        assert (busy.value.name, late.value.name) == ("busy", "too_late")
        assert busy.value.retry_after_ms is not None
        assert service.load().queued == 0


@pytest.mark.parametrize(
    "changes",
    [
        {"image": PayloadPart("jpeg", 3)},
        {"camera": None},
        {"camera": Pinhole.from_hfov(99, 48, 1.0)},
        {"depth_range_m": (0.0, 0.0)},
    ],
)
def test_pictures_that_make_no_sense_are_refused_and_the_worker_goes_on(
    changes: dict[str, object], bus: BusSettings, client: Node
) -> None:
    backend = Patient()
    backend.let.set()
    with Node("perception", "w6", bus) as node:
        serving(node, backend, PerceptionSettings(worker="w6"))
        bad, payload = request(**changes)
        with pytest.raises(Refused) as error:
            client.ask(PERCEPTION_INFER, bad, payload=payload, worker="w6", timeout_s=10)
        assert error.value.name == "bad_message"
        good, payload = request()
        reply = client.ask(PERCEPTION_INFER, good, payload=payload, worker="w6", timeout_s=10).message
        assert reply.backend == "patient"


def test_texts_and_load(bus: BusSettings, client: Node) -> None:
    with Node("perception", "w7", bus) as node:
        serving(node, Simulated("because"), PerceptionSettings(worker="w7", capacity=3))
        asked = InferRequest(stamp_ns=clock_ns(), texts=["seems like there is a tv", "bed"])
        reply = client.ask(PERCEPTION_TEXT, asked, worker="w7", timeout_s=10).message
        assert len(reply.embeddings) == 2
        tv, bed = (unpack_embedding(e, Simulated.embedding_dim) for e in reply.embeddings)
        assert tv @ bed < 0.5
        assert reply.words == ["tv", "bed"]
        other = InferRequest(stamp_ns=clock_ns(), texts=["seems like there is a Fernseher", "Bett"])
        same = client.ask(PERCEPTION_TEXT, other, worker="w7", timeout_s=10).message
        assert (same.words, same.embeddings) == (reply.words, reply.embeddings)
        for texts, name in ((["flux capacitor"], "bad_target"), ([], "bad_message"), (["bed"] * 1000, "bad_message")):
            with pytest.raises(Refused) as error:
                client.ask(PERCEPTION_TEXT, InferRequest(stamp_ns=1, texts=texts), worker="w7", timeout_s=10)
            assert error.value.name == name
        load = client.ask(PERCEPTION_LOAD, worker="w7", timeout_s=10).message
        assert (load.backend, load.why, load.queued, load.capacity) == ("simulated", "because", 0, 3)


def test_times_are_published_when_something_was_processed_and_known_all_along(bus: BusSettings, client: Node) -> None:
    with Node("perception", "w9", bus) as node:
        service = serving(node, Simulated("because"), PerceptionSettings(worker="w9"))
        heard: list[WorkerLoad] = []
        table = client.table(PERCEPTION_LOAD, on_message=lambda row: heard.append(row.message), worker="w9")
        until(lambda: service._load_publisher.matched)

        def publish() -> None:
            n, service._load_published_s = len(heard), 0.0
            service.step()
            until(lambda: len(heard) > n)

        publish()
        publish()
        tell_truth(client, 1)
        asked, payload = request(seq=1)
        client.ask(PERCEPTION_INFER, asked, payload=payload, worker="w9", timeout_s=10)
        publish()
        publish()
        assert [bool(load.times) for load in heard] == [True, False, True, False]
        assert table.rows()[0].message.times == service.load().times


def test_the_process_says_its_backend_and_ends_on_sigterm(bus: BusSettings, client: Node) -> None:
    env = {
        "SURVEILNAV_BUS__ROUTER": bus.router,
        "SURVEILNAV_BUS__BUILDING": "b",
        "SURVEILNAV_PERCEPTION__BACKEND": "simulated",
        "SURVEILNAV_PERCEPTION__WORKER": "w8",
        "PATH": "/usr/bin:/bin",
        "HOME": "/tmp",
    }
    process = subprocess.Popen(
        [sys.executable, "-m", "surveilnav.services.perception"], env=env, stderr=subprocess.PIPE, text=True
    )
    try:
        until(lambda: "w8" in client.alive("perception"), timeout_s=30.0)
        process.terminate()
        _, said = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == 0
    assert "simulated" in said


def test_a_wrong_backend_is_one_line_and_exit_1(bus: BusSettings) -> None:
    env = {
        "SURVEILNAV_BUS__ROUTER": bus.router,
        "SURVEILNAV_PERCEPTION__BACKEND": "magic",
        "PATH": "/usr/bin:/bin",
        "HOME": "/tmp",
    }
    done = subprocess.run(
        [sys.executable, "-m", "surveilnav.services.perception"], env=env, capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 1
    assert "onnx-coco" in done.stderr
    assert "Traceback" not in done.stderr
