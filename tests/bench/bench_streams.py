"""What reading RTSP streams costs: CPU and memory of each, with several at once.

    python -m tests.bench.bench_streams

Each stream is read by a process of its own, as camera nodes do, which takes one picture a second. All pictures of a stream have
to be decoded for that, since each is told by its difference from the one before.
"""

from __future__ import annotations

import argparse
import multiprocessing
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from surveilnav.services.camera_node.sources.readers.rtsp import RtspReader
from tests import streams

#: Name, size, pictures a second.
KINDS = (("main stream", (1920, 1080), 15), ("HD", (1280, 720), 15), ("substream", (640, 360), 5))
_WARM_UP_S = 5.0


def read(address: str, seconds: float, results: multiprocessing.Queue[tuple[float, float, int]]) -> None:
    """Reads a stream; puts (share of a core, MiB of memory, pictures)."""
    reader = RtspReader(address, 1.0)
    reader.open()
    until_s = time.monotonic() + _WARM_UP_S
    while time.monotonic() < until_s:
        reader.read()
    cpu_s, began_s, n = time.process_time(), time.monotonic(), 0
    while time.monotonic() - began_s < seconds:
        reader.read()
        n += 1
    share = (time.process_time() - cpu_s) / (time.monotonic() - began_s)
    reader.close()
    results.put((share, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, n))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--streams", type=int, nargs="+", default=[1, 16])
    parser.add_argument("--seconds", type=float, default=20.0)
    args = parser.parse_args()
    print("| stream | at once | a core's share each | memory each | pictures a second each |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for _, size_px, fps in KINDS:
            frames = [streams.room(t, size_px) for t in range(2 * fps)]
            streams.write_looped_video(Path(folder) / f"{size_px[0]}.mp4", frames, 600.0, fps)
        context = multiprocessing.get_context("spawn")
        for name, size_px, fps in KINDS:
            for n in args.streams:
                with streams.rtsp_server(Path(folder)) as (address, _):
                    results = context.Queue()
                    one = f"{address}/{size_px[0]}.mp4"
                    processes = [context.Process(target=read, args=(one, args.seconds, results)) for _ in range(n)]
                    for process in processes:
                        process.start()
                    found = np.array([results.get(timeout=60 + 4 * args.seconds) for _ in processes])
                    for process in processes:
                        process.join()
                share, memory_mib, pictures = found.mean(axis=0)
                what = f"{name}, {size_px[0]} x {size_px[1]}, {fps} pictures a second"
                print(
                    f"| {what} | {n} | {share:.1%} | {memory_mib:.0f} MiB | {pictures / args.seconds:.2f} |", flush=True
                )


if __name__ == "__main__":
    main()
