"""Compiled loops on many threads: a loop over rows is cut into bands.

Kernels are plain ``@njit(nogil=True)`` over bands of rows and are spread over threads by ``in_bands``. Every row is
computed alone, so the number of threads can't change a result, and neither threads nor forks can upset a threading
layer.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise
from typing import Any

_threads = os.cpu_count() or 1


def use_threads(n: int) -> None:
    """Sets on how many threads kernels run from now on. Use one where other processes already fill the cores, since handing out
    bands then only costs. Pictures don't depend on it."""
    global _threads
    _threads = n


def threads() -> int:
    """The number that ``use_threads`` set last; the number of cores if it wasn't called."""
    return _threads


@lru_cache(maxsize=1)
def _pool(pid: int) -> ThreadPoolExecutor:  # keyed by process: a pool doesn't survive a fork
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="shading")


def in_bands(kernel: Callable[..., Any], rows: int, *args: Any) -> None:
    """Calls ``kernel(row0, row1, *args)`` over bands that cover ``range(rows)``, on all cores (``use_threads``)."""
    workers = _threads
    bands = min(rows, 4 * workers) if workers > 1 else 1
    if bands <= 1:
        kernel(0, rows, *args)
        return
    edges = [rows * i // bands for i in range(bands + 1)]
    futures = [_pool(os.getpid()).submit(kernel, a, b, *args) for a, b in pairwise(edges)]
    for future in futures:
        future.result()
