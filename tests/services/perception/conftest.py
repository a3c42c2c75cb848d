"""A router, a client, and a backend that does as it is told."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from surveilnav.bus import BusSettings, Node, clock_ns
from surveilnav.bus.router import free_port, open_router
from surveilnav.contract import PERCEPTION_INFER
from surveilnav.errors import PerceptionError, TargetError
from surveilnav.geometry import Pinhole
from surveilnav.messages import InferRequest, ModelIds
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.sensing.packing import encode_rgbd
from surveilnav.sensing.views import DetectedObject, ViewPerception
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.service import PerceptionService
from tests.waiting import patient

CAMERA = Pinhole.from_hfov(64, 48, math.radians(79))
RANGE_M = (0.5, 5.0)
DIM = 4


class Scripted(Backend):
    """Two stages, each of which waits for ``let`` and notes whom it looked at together.

    A picture's shade names it; it fails at the shades in ``bad``, and says what it says of the probe at any other.
    """

    name, why, embedding_dim = "scripted", "for tests", DIM
    models = ModelIds("d@1", "s@1", "e@1")

    def __init__(self, *, needs_prompts: bool = False) -> None:
        self.needs_prompts = needs_prompts
        self.let = {"detect": threading.Event(), "embed": threading.Event()}
        for event in self.let.values():
            event.set()
        self.batches: dict[str, list[list[int]]] = {"detect": [], "embed": []}
        self.bad: set[int] = set()
        self.embedding = np.array([0.6, 0.8, 0, 0], np.float32)
        self.box_px = (4.0, 4.0, 20.0, 20.0)
        self.texts: list[str] = []
        self.text_batches: list[int] = []
        self.stages = (Stage("detect", self._detect), Stage("embed", self._embed))

    def _pass(self, stage: str, batch: Sequence[ViewTask]) -> None:
        if batch[0].key == ("probe",):
            return
        shades = [int(task.view.rgb[0, 0, 0]) for task in batch]
        self.batches[stage].append(shades)
        assert self.let[stage].wait(20)
        if self.bad & set(shades):
            raise PerceptionError("a bad picture")

    def _detect(self, batch: Sequence[ViewTask]) -> None:
        self._pass("detect", batch)

    def _embed(self, batch: Sequence[ViewTask]) -> None:
        self._pass("embed", batch)
        for task in batch:
            thing = DetectedObject("chair", 0.9, self.box_px, None, np.eye(DIM, dtype=np.float32)[0])
            task.result = ViewPerception(self.name, (thing,), self.embedding)

    def embed_texts(self, texts: Sequence[str]) -> np.ndarray:
        if "flux capacitor" in texts:
            raise TargetError("no flux capacitor is known")
        self.texts += texts
        self.text_batches.append(len(texts))
        return np.eye(DIM, dtype=np.float32)[[len(text) % DIM for text in texts]]


@pytest.fixture(scope="module")
def bus() -> Iterator[BusSettings]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with open_router(endpoint):
        yield BusSettings(router=endpoint, building="b")


@pytest.fixture
def client(bus: BusSettings) -> Iterator[Node]:
    with Node("test", "client", bus, alive=False) as node:
        yield patient(node)


class Worker:
    """One worker on the bus, and a client that asks it."""

    def __init__(self, node: Node, client: Node, backend: Backend, settings: PerceptionSettings) -> None:
        self.service = PerceptionService(node, backend, settings)
        self.client, self.name = client, settings.worker

    def ask(self, asked: tuple[InferRequest, bytes], stream: Any = PERCEPTION_INFER) -> Any:
        """The answer to a request."""
        return self.client.ask(stream, asked[0], payload=asked[1], worker=self.name, timeout_s=20).message


@pytest.fixture
def make_worker(bus: BusSettings, client: Node) -> Iterator[Callable[..., Worker]]:
    """Starts a worker with a backend; settings as keywords; ``warm=False`` leaves it unready."""
    nodes: list[Node] = []

    def make(backend: Backend, *, warm: bool = True, folder: Path | None = None, **settings: Any) -> Worker:
        name = f"w{clock_ns()}"
        node = Node("perception", name, bus.model_copy(update={"handover_folder": folder}))
        node.__enter__()
        nodes.append(node)
        worker = Worker(node, client, backend, PerceptionSettings(worker=name, **settings))
        if warm:
            worker.service.warm_up()
        return worker

    yield make
    for node in nodes:
        node.__exit__(None, None, None)


@pytest.fixture
def request_of() -> Callable[..., tuple[InferRequest, bytes]]:
    """Makes a request about a picture all of one shade: another shade is another picture."""

    def make(shade: int = 0, source: str = "robot/r", **changes: object) -> tuple[InferRequest, bytes]:
        depth = np.full((48, 64), 2.0, np.float32)
        payload, image, part = encode_rgbd(np.full((48, 64, 3), shade, np.uint8), depth, depth_range_m=RANGE_M)
        asked = InferRequest(
            stamp_ns=clock_ns(),
            source=source,
            view=shade,
            seq=1,
            camera=CAMERA,
            image=image,
            depth=part,
            depth_range_m=RANGE_M,
        )
        return msgspec.structs.replace(asked, **changes), payload

    return make


@pytest.fixture
def scripted() -> type[Scripted]:
    return Scripted
