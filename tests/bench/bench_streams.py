"""What reading RTSP streams costs, and how many one perception worker looks at.

    python -m tests.bench.bench_streams
    python -m tests.bench.bench_streams --perceived

Each stream is read by a process of its own, as camera nodes do, which takes one picture a second. All pictures of a stream have
to be decoded for that, since each is told by its difference from the one before. ``--perceived``: every picture that was taken
is sent over a router to one perception worker with the backend ``compact``, which has to answer before the next second's picture.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from surveilnav.bus import BusSettings, Node, clock_ns
from surveilnav.bus.router import free_port
from surveilnav.contract import PERCEPTION_INFER
from surveilnav.errors import BusError
from surveilnav.geometry import Pinhole
from surveilnav.messages import InferRequest
from surveilnav.sensing.packing import encode_rgbd
from surveilnav.services.camera_node.sources.readers.reader import StreamError
from surveilnav.services.camera_node.sources.readers.rtsp import RtspReader
from tests import streams
from tests.measured_processes import memory_mib, processes

#: Name, size, pictures a second.
KINDS = (("main stream", (1920, 1080), 15), ("HD", (1280, 720), 15), ("substream", (640, 360), 5))
_WARM_UP_S = 8.0
_RANGE_M = (0.1, 10.0)
_WORKER = "w"


@dataclass
class Result:
    """What one reader got and cost.

    Attributes:
        lost: how often the stream ended or stalled.
        unanswered: pictures that perception didn't answer in time, the last one because of ``why``.
        answers_s: how long perception took for each picture that it answered.
        n_warm_up: pictures that it answered before the measurement began.
    """

    pictures: int = 0
    lost: int = 0
    unanswered: int = 0
    why: str = ""
    share: float = 0.0
    memory_mib: float = 0.0
    answers_s: list[float] = field(default_factory=list)
    n_warm_up: int = 0


def read(address: str, number: int, seconds: float, bus: BusSettings | None, results: multiprocessing.Queue) -> None:
    """Reads a stream; with ``bus``, each picture is also sent to perception. Puts a Result."""
    result, reader = Result(), RtspReader(address, 1.0)
    with contextlib.ExitStack() as stack:
        node = stack.enter_context(Node("camera", f"c{number}", bus, alive=False)) if bus else None
        until_s = time.monotonic() + _WARM_UP_S
        warm_up = Result()
        _read_until(until_s, reader, number, node, warm_up)
        result.n_warm_up = len(warm_up.answers_s)
        began_cpu_s, began_s = time.process_time(), time.monotonic()
        _read_until(began_s + seconds, reader, number, node, result)
        result.share = (time.process_time() - began_cpu_s) / (time.monotonic() - began_s)
        result.memory_mib = memory_mib(os.getpid())
    results.put(result)


def _read_until(until_s: float, reader: RtspReader, number: int, node: Node | None, result: Result) -> None:
    is_open = False
    while time.monotonic() < until_s:
        try:
            if not is_open:
                reader.open()
                is_open = True
            rgb = reader.read().rgb
        except StreamError:
            result.lost += 1
            reader.close()
            is_open = False
            continue
        result.pictures += 1
        if node is not None:
            _perceive(node, rgb, number, result)
    reader.close()


def _perceive(node: Node, rgb: np.ndarray, number: int, result: Result) -> None:
    no_depth_m = np.full(rgb.shape[:2], np.nan, np.float32)
    payload, image, depth = encode_rgbd(rgb, no_depth_m, depth_range_m=_RANGE_M, jpeg_quality=85)
    began_s = time.monotonic()
    lens = Pinhole.from_hfov(rgb.shape[1], rgb.shape[0], np.radians(90))
    request = InferRequest(
        stamp_ns=clock_ns(),
        source=f"camera/c{number}",
        seq=result.pictures,
        camera=lens,
        image=image,
        depth=depth,
        depth_range_m=_RANGE_M,
        depth_source="none",
        deadline_ms=900,
        asker=f"c{number}",
    )
    try:
        node.ask(PERCEPTION_INFER, request, payload=payload, timeout_s=1.0, worker=_WORKER)
        result.answers_s.append(time.monotonic() - began_s)
    except BusError as error:
        result.unanswered += 1
        result.why = str(error)


def gather(n: int, address: str, seconds: float, bus: BusSettings | None) -> list[Result]:
    """Results of n readers of one address at the same time."""
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    readers = [context.Process(target=read, args=(address, k, seconds, bus, results)) for k in range(n)]
    for reader in readers:
        reader.start()
    found = [results.get(timeout=120 + 4 * seconds) for _ in readers]
    for reader in readers:
        reader.join()
    return found


def measure_read(name: str, size_px: tuple[int, int], fps: int, n: int, seconds: float, folder: Path) -> str:
    with streams.rtsp_server(folder) as (address, _):
        found = gather(n, f"{address}/{size_px[0]}.mp4", seconds, None)
    share, memory_mib, rate, lost = np.mean(
        [(r.share, r.memory_mib, r.pictures / seconds, r.lost) for r in found], axis=0
    )
    what = f"{name}, {size_px[0]} x {size_px[1]}, {fps} pictures a second"
    return f"| {what} | {n} | {share:.1%} | {memory_mib:.0f} MiB | {rate:.2f} | {lost * n:.0f} |"


def measure_perceived(n: int, seconds: float, folder: Path) -> str:
    """Substreams with a perception worker."""
    bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}", building="streams", connect_timeout_s=30)
    environment = {
        "SURVEILNAV_BUS__ROUTER": bus.router,
        "SURVEILNAV_BUS__BUILDING": bus.building,
        "SURVEILNAV_BUS__LOG_LEVEL": "error",
        "SURVEILNAV_PERCEPTION__BACKEND": "compact",
        "SURVEILNAV_PERCEPTION__WORKER": _WORKER,
        # the pictures repeat, and each is to be looked at
        "SURVEILNAV_PERCEPTION__CACHE_MB": "0",
        "SURVEILNAV_PERCEPTION__DISK_CACHE_MB": "0",
    }
    commands = {
        "router": ["surveilnav.bus.router", "--listen", bus.router],
        "perception": ["surveilnav.services.perception"],
    }
    size_px = KINDS[-1][1]
    with (
        streams.rtsp_server(folder) as (address, _),
        processes(commands, environment, str(folder)) as services,
    ):
        cpu_s = {name: s.cpu_s() for name, s in services.items()}
        found = gather(n, f"{address}/{size_px[0]}.mp4", seconds, bus)
        spent_s = {name: s.cpu_s() - cpu_s[name] for name, s in services.items()}
        memory_mib = services["perception"].memory_mib()
    answers_s = np.array([t for r in found for t in r.answers_s])
    pictures, unanswered = sum(r.pictures for r in found), sum(r.unanswered for r in found)
    if not len(answers_s):
        raise SystemExit(f"perception answered nothing: {found[0].why}")
    per_picture_ms = 1000 * spent_s["perception"] / (len(answers_s) + sum(r.n_warm_up for r in found))
    median, p99 = 1000 * np.percentile(answers_s, [50, 99])
    return (
        f"| {n} | {pictures / seconds:.1f} | {len(answers_s) / seconds:.1f} | {unanswered} | {median:.0f} ms | {p99:.0f} ms "
        f"| {per_picture_ms:.0f} ms | {memory_mib:.0f} MiB | {np.mean([r.share for r in found]):.1%} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--streams", type=int, nargs="+", default=[1, 16])
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--perceived", action="store_true", help="have a worker with `compact` look at each picture")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for _, size_px, fps in KINDS[-1:] if args.perceived else KINDS:
            frames = [streams.room(t, size_px) for t in range(2 * fps)]
            streams.write_looped_video(folder / f"{size_px[0]}.mp4", frames, 600.0, fps)
        if args.perceived:
            print(
                "| streams | pictures a second | answered a second | unanswered | median answer | 99 % "
                "| worker's processor time each | worker's memory | a core's share of each reader |\n"
                + "|---" * 9
                + "|"
            )
            for n in args.streams:
                print(measure_perceived(n, args.seconds, folder), flush=True)
            return
        print(
            "| stream | at once | a core's share each | memory each | pictures a second each | interrupted |\n"
            + "|---" * 6
            + "|"
        )
        for kind in KINDS:
            for n in args.streams:
                print(measure_read(*kind, n, args.seconds, folder), flush=True)


if __name__ == "__main__":
    main()
