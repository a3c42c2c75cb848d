"""Worker processes, one job each: numba's threads and ONNX's don't survive a fork, and memory goes back after a job."""

from __future__ import annotations

import multiprocessing
import os
import signal
from multiprocessing.pool import Pool

from surveilnav.building.shading import use_threads


def worker_pool(workers: int) -> Pool:
    """A pool whose workers leave Ctrl-C to their parent, which ends them, and share the cores."""
    threads = max(1, (os.cpu_count() or 1) // workers)
    return multiprocessing.get_context("spawn").Pool(workers, _begin, (threads,), maxtasksperchild=1)


def _begin(threads: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    use_threads(threads)
