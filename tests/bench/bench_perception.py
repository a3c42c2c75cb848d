"""How many views a perception worker answers, and what becomes of the others. Prints tables.

.venv/bin/python tests/bench/bench_perception.py [--seconds 15] [--requests 10000] [--only memory]

Router, worker and callers are processes of their own, on one machine, over real Zenoh. ``onnx-coco`` runs where its
weights are. ``timed`` stands in for a GPU: its stages sleep for a time of their own and a little for each view.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.util
import math
import os
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType

import cv2
import msgspec
import numpy as np

from surveilnav.bus import BusSettings, Node, Refused, Unanswered, clock_ns
from surveilnav.bus.router import free_port
from surveilnav.contract import PERCEPTION_INFER, PERCEPTION_LOAD
from surveilnav.errors import SurveilNavError
from surveilnav.geometry import Pinhole
from surveilnav.histogram import quantile_ms
from surveilnav.messages import InferRequest, ModelIds, PayloadPart, WorkerLoad
from surveilnav.perception.backend import Backend, Stage, ViewTask
from surveilnav.perception.presets import NetworkSettings, onnx_coco
from surveilnav.sensing.packing import encode_rgbd
from surveilnav.sensing.views import DetectedObject, ViewPerception
from surveilnav.services.fusion.intake.workers import Workers
from surveilnav.services.perception.config import PerceptionSettings
from surveilnav.services.perception.service import PerceptionService

CAMERA = Pinhole.from_hfov(640, 480, math.radians(79))
RANGE_M = (0.5, 5.0)
#: Milliseconds of a batch, and of each view in it.
STAGES_MS = {"detect": (30.0, 3.0), "segment": (10.0, 1.0), "embed": (10.0, 1.0)}
DIM = 512


class Timed(Backend):
    """Takes as long as it says; sees five things everywhere."""

    name, why, embedding_dim = "timed", "stands in for a GPU", DIM
    models = ModelIds("timed", "timed", "timed")
    needs_prompts = True
    best_batch = 8

    def __init__(self, speed: float = 1.0) -> None:
        self.stages = tuple(Stage(n, self._slept(n, a / speed, b / speed)) for n, (a, b) in STAGES_MS.items())

    def _slept(self, name: str, batch_ms: float, view_ms: float) -> Callable[[Sequence[ViewTask]], None]:
        def run(batch: Sequence[ViewTask]) -> None:
            time.sleep((batch_ms + view_ms * len(batch)) / 1000)
            for task in batch if name == "embed" else ():
                vector = np.full(DIM, DIM**-0.5, np.float32)
                things = [
                    DetectedObject(
                        "chair", 0.9, (10.0 * k, 10.0, 10.0 * k + 90, 120.0), np.ones((110, 90), bool), vector
                    )
                    for k in range(5)
                ]
                task.result = ViewPerception(self.name, tuple(things), vector)

        return run

    def embed_texts(self, texts: Sequence[str]) -> np.ndarray:
        return np.tile(np.full(DIM, DIM**-0.5, np.float32), (len(texts), 1))


def serve(backend: str, speed: float) -> None:
    """A worker, until SIGTERM."""
    settings = PerceptionSettings()
    made: Backend = (
        Timed(speed) if backend == "timed" else onnx_coco(NetworkSettings(download=False), "for the benchmark")
    )
    with Node("perception", settings.worker) as node:
        service = PerceptionService(node, made, settings)
        service.warm_up()
        node.run(service.step, idle_s=0.2)


@contextlib.contextmanager
def process(*command: str, **settings: object) -> Iterator[subprocess.Popen[bytes]]:
    env = os.environ | {name.upper(): str(value) for name, value in settings.items()}
    started = subprocess.Popen(
        [sys.executable, *command], env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield started
    finally:
        started.send_signal(signal.SIGCONT)
        started.terminate()
        started.wait()


@contextlib.contextmanager
def worker(
    bus: BusSettings, name: str, backend: str, speed: float = 1.0, **settings: object
) -> Iterator[subprocess.Popen[bytes]]:
    """A ready worker's process."""
    command = (__file__, "--serve", backend, "--speed", str(speed))
    named = {f"SURVEILNAV_PERCEPTION__{key}": value for key, value in settings.items()}
    env = {"SURVEILNAV_BUS__ROUTER": bus.router, "SURVEILNAV_PERCEPTION__WORKER": name}
    with process(*command, **env, **named) as started, Node("bench", f"watch-{name}", bus, alive=False) as node:
        while not is_ready(node, name):
            time.sleep(0.1)
        yield started


def is_ready(node: Node, name: str) -> bool:
    try:
        return load_of(node, name).ready
    except SurveilNavError:
        return False


def load_of(node: Node, name: str) -> WorkerLoad:
    load: WorkerLoad = node.ask(PERCEPTION_LOAD, worker=name, timeout_s=2.0).message
    return load


def pictures(count: int) -> list[tuple[InferRequest, bytes]]:
    """Requests about different pictures of soft noise."""
    rng = np.random.default_rng(0)
    out = []
    for seq in range(count):
        rgb = cv2.resize(rng.integers(0, 256, (12, 16, 3), np.uint8), (640, 480), interpolation=cv2.INTER_CUBIC)
        payload, image, depth = encode_rgbd(rgb, np.full((480, 640), 2.0, np.float32), depth_range_m=RANGE_M)
        request = InferRequest(
            stamp_ns=clock_ns(),
            source="camera/c",
            view=0,
            seq=seq,
            camera=CAMERA,
            image=image,
            depth=depth,
            depth_range_m=RANGE_M,
            prompts=["chair"],
        )
        out.append((request, payload))
    return out


@dataclass
class Tally:
    """What became of requests: milliseconds until the answer or the refusal, by what came."""

    took_ms: dict[str, list[float]] = field(default_factory=dict)
    asked: int = 0
    seconds: float = 0.0
    lock: threading.Lock = field(default_factory=threading.Lock)

    def next(self) -> int:
        """The number of the next request."""
        with self.lock:
            self.asked += 1
            return self.asked - 1

    def add(self, outcome: str, took_ms: float) -> None:
        with self.lock:
            self.took_ms.setdefault(outcome, []).append(took_ms)

    def quantiles(self, outcome: str) -> tuple[float, float, float]:
        took = self.took_ms.get(outcome, [math.nan])
        p50, p95, most = np.quantile(took, [0.5, 0.95, 1.0]).tolist()
        return p50, p95, most

    def counts(self) -> Counter[str]:
        return Counter({outcome: len(took) for outcome, took in self.took_ms.items()})


def flood(
    bus: BusSettings,
    name: str,
    callers: int,
    until: Callable[[int, float], bool],
    *,
    waits: bool,
    first: int = 0,
) -> Tally:
    """``callers`` threads ask one after the other until ``until`` (of all asked, and seconds) holds. ``waits``: who is
    refused waits as it is told. No two ask the same: each has a word of its own, counted from ``first``."""
    tally, asked, together = Tally(), pictures(64), threading.Barrier(callers)
    begun_s: list[float] = []

    def call(k: int) -> None:
        with Node("bench", f"caller-{k}", bus, alive=False) as node:
            together.wait()
            begun_s.append(time.monotonic())
            while not until(tally.asked, time.monotonic() - begun_s[0]):
                n = tally.next()
                request, payload = asked[n % len(asked)]
                request = msgspec.structs.replace(request, source=f"camera/c{k}", seq=n, prompts=[f"word {first + n}"])
                pause_s = asked_once(node, name, request, payload, tally)
                time.sleep(pause_s if waits else 0.0)

    threads = [threading.Thread(target=call, args=(k,)) for k in range(callers)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    tally.seconds = time.monotonic() - begun_s[0]
    return tally


def asked_once(node: Node, name: str, request: InferRequest, payload: bytes, tally: Tally) -> float:
    """Asks a worker, and notes what came; returns how many seconds to wait before asking again."""
    begin_s, pause_ms = time.perf_counter(), 0
    try:
        node.ask(PERCEPTION_INFER, request, payload=payload, worker=name, timeout_s=60.0)
        outcome = "answered"
    except Refused as error:
        outcome, pause_ms = error.name, error.retry_after_ms or 0
    except Unanswered:
        outcome = "unanswered"
    tally.add(outcome, (time.perf_counter() - begin_s) * 1e3)
    return pause_ms / 1e3


def for_seconds(seconds: float) -> Callable[[int, float], bool]:
    return lambda asked, passed_s: passed_s >= seconds


def throughput(bus: BusSettings, backend: str, seconds: float) -> None:
    print(
        f"\n### Throughput, {backend}\n\n| callers | largest batch | views/s | p50 ms | p95 ms |\n|---|---|---|---|---|"
    )
    for most in (1, 4, 8):
        with worker(bus, f"t{most}", backend, max_batch=most, cache_mb=0):
            for callers in (1, 4, 16):
                tally = flood(bus, f"t{most}", callers, for_seconds(seconds), waits=True)
                rate = tally.counts()["answered"] / tally.seconds
                p50, p95, _ = tally.quantiles("answered")
                print(f"| {callers} | {most} | {rate:.1f} | {p50:.0f} | {p95:.0f} |", flush=True)


def overload(bus: BusSettings, backend: str, seconds: float) -> None:
    print(f"\n### Overload, {backend}, 16 views may be under way\n")
    print("| callers | who is refused | asked | answered | busy | unanswered | p95 answered ms | p95 refused ms |")
    print("|---|---|---|---|---|---|---|---|")
    with worker(bus, "o", backend, cache_mb=0), Node("bench", "watch", bus, alive=False) as node:
        for callers, waits in ((16, True), (32, True), (64, True), (64, False)):
            tally = flood(bus, "o", callers, for_seconds(seconds), waits=waits)
            counts = tally.counts()
            assert sum(counts.values()) == tally.asked, "somebody got neither an answer nor a refusal"
            print(
                f"| {callers} | {'waits as told' if waits else 'asks at once'} | {tally.asked} | {counts['answered']} "
                f"| {counts['busy']} | {counts['unanswered']} | {tally.quantiles('answered')[1]:.0f} "
                f"| {tally.quantiles('busy')[1]:.0f} |",
                flush=True,
            )
        times = load_of(node, "o").times
        print("\n| stage | views | p50 ms | p95 ms |\n|---|---|---|---|")
        for stage, counts_of in times.items():
            p50, p95 = quantile_ms(counts_of, 0.5) or math.nan, quantile_ms(counts_of, 0.95) or math.nan
            print(f"| {stage} | {sum(counts_of)} | {p50:.1f} | {p95:.1f} |")


def memory(bus: BusSettings, requests: int) -> None:
    print(f"\n### Memory over {requests} requests, timed\n")
    print("| requests | no answer is kept, MB | 8 MB of answers are kept, MB |\n|---|---|---|")
    with (
        worker(bus, "m0", "timed", speed=20.0, cache_mb=0) as bare,
        worker(bus, "m8", "timed", speed=20.0, cache_mb=8) as keeping,
        Node("bench", "watch", bus, alive=False) as node,
    ):
        asked = 0
        for step in (0.05, 0.25, 0.5, 0.75, 1.0):
            n, first = int(requests * step) - asked, asked
            for name in ("m0", "m8"):
                tally = flood(bus, name, 8, lambda done, _, n=n: done >= n, waits=True, first=first)
                assert set(tally.counts()) <= {"answered", "busy"}, tally.counts()
            asked += n
            print(f"| {asked} | {resident_mb(bare.pid):.1f} | {resident_mb(keeping.pid):.1f} |", flush=True)
        assert load_of(node, "m8").cached == 0, "every request is about something new"


def resident_mb(pid: int) -> float:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024


def frozen(bus: BusSettings) -> None:
    print("\n### A frozen worker beside a good one, timed\n\n| | p50 ms | p95 ms | longest ms |\n|---|---|---|---|")
    with (
        worker(bus, "a", "timed", cache_mb=0) as first,
        worker(bus, "b", "timed", cache_mb=0),
        Node("bench", "fusion", bus, alive=False) as node,
    ):
        workers = Workers(node)
        time.sleep(2.5)  # until both have said how busy they are
        row("both work", *asked_through(workers, 100))
        first.send_signal(signal.SIGSTOP)
        row("one is frozen: the 10 views after", *asked_through(workers, 10))
        row("the 90 after these", *asked_through(workers, 90))


def asked_through(workers: Workers, count: int) -> tuple[float, float, float]:
    tally = Tally()
    for request, payload in pictures(count):
        begin_s = time.perf_counter()
        workers.ask(PERCEPTION_INFER, request, payload, timeout_s=30.0)
        tally.add("answered", (time.perf_counter() - begin_s) * 1e3)
    return tally.quantiles("answered")


def row(name: str, *numbers: float) -> None:
    print(f"| {name} | " + " | ".join(f"{number:.0f}" for number in numbers) + " |", flush=True)


def bad_input(bus: BusSettings) -> None:
    """How soon each row of the test's table is refused."""
    table = test_table()
    good, payload = pictures(1)[0]
    assert good.image is not None
    rest = payload[good.image.n_bytes :]
    rows = [
        (msgspec.structs.replace(good, image=PayloadPart("jpeg", len(p))), p + rest) for p in table.PICTURES.values()
    ]
    rows += [(msgspec.structs.replace(good, **changes), payload) for changes, _ in table.REQUESTS.values()]
    tally = Tally()
    with worker(bus, "bad", "timed"), Node("bench", "bad-caller", bus, alive=False) as node:
        for request, data in rows * 10:
            begin_s = time.perf_counter()
            try:
                node.ask(PERCEPTION_INFER, request, payload=data, worker="bad", timeout_s=10.0)
                outcome = "answered"
            except Refused:
                outcome = "refused"
            tally.add(outcome, (time.perf_counter() - begin_s) * 1e3)
    print(
        f"\n### Bad input, {len(rows)} kinds, ten times each\n\n| | p50 ms | p95 ms | longest ms |\n|---|---|---|---|"
    )
    for outcome, count in tally.counts().items():
        row(f"{outcome} ({count})", *tally.quantiles(outcome))


def test_table() -> ModuleType:
    path = Path(__file__).parents[1] / "services" / "perception" / "test_bad_input.py"
    spec = importlib.util.spec_from_file_location("bad_input_table", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=15.0, help="of each row of throughput and overload")
    parser.add_argument("--requests", type=int, default=10_000, help="for memory")
    parser.add_argument("--only", default="", help="parts whose name has this in it: memory, overload-timed, ...")
    parser.add_argument("--serve", choices=("timed", "onnx-coco"), help=argparse.SUPPRESS)
    parser.add_argument("--speed", type=float, default=1.0, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(arguments.serve, arguments.speed)
        return
    bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}")
    with process("-m", "surveilnav.bus.router", "--listen", bus.router):
        parts: dict[str, Callable[[], None]] = {
            "bad-input": lambda: bad_input(bus),
            "frozen": lambda: frozen(bus),
            "memory": lambda: memory(bus, arguments.requests),
        }
        for backend in backends():
            parts[f"throughput-{backend}"] = lambda b=backend: throughput(bus, b, arguments.seconds)
            parts[f"overload-{backend}"] = lambda b=backend: overload(bus, b, arguments.seconds)
        for name, part in parts.items():
            if arguments.only in name:
                part()


def backends() -> list[str]:
    """Those that can run here."""
    try:
        onnx_coco(NetworkSettings(download=False), "are its weights here?")
    except SurveilNavError as error:
        print(f"onnx-coco is left out: {error}")
        return ["timed"]
    return ["timed", "onnx-coco"]


if __name__ == "__main__":
    main()
