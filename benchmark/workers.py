"""Worker processes, one job each: numba's threads and ONNX's don't survive a fork, and memory goes back after a job."""

from __future__ import annotations

import multiprocessing
import signal
from multiprocessing.pool import Pool


def worker_pool(workers: int) -> Pool:
    """A pool whose workers leave Ctrl-C to their parent, which ends them."""
    return multiprocessing.get_context("spawn").Pool(workers, _ignore_interrupts, maxtasksperchild=1)


def _ignore_interrupts() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
