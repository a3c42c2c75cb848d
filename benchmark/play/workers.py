"""Jobs in processes of their own: numba's threads and ONNX's don't survive a fork, and memory goes back after a job.

The standard library's pools don't fit: ``multiprocessing.Pool`` waits for ever for the job of a worker that was killed, and
``ProcessPoolExecutor`` ends all of them.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from multiprocessing.connection import Connection, wait
from multiprocessing.context import SpawnProcess
from typing import Generic, NamedTuple, TypeVar

from surveilnav.errors import SurveilNavError
from surveilnav.simulator.render.bands import use_threads

#: OpenBLAS takes its kernels by processor and splits sums by core, so that sums differ in their last bits. These kernels run
#: on every x86 processor with AVX2; on other architectures the name is ignored.
_SAME_SUMS = {"OPENBLAS_CORETYPE": "Haswell", "OPENBLAS_NUM_THREADS": "1"}

J = TypeVar("J")
R = TypeVar("R")


class JobResult(NamedTuple, Generic[J, R]):
    """A job that ended: what it returned, or ``error``: what a user is to be told, the traceback, or how its process died."""

    job: J
    result: R | None
    error: str

    @property
    def why(self) -> str:
        """The error's last line; empty: there was none."""
        return self.error.strip().rpartition("\n")[2]


def in_workers(
    work: Callable[[J], R], jobs: Sequence[J], workers: int, poll_s: float | None = None
) -> Iterator[JobResult[J, R] | None]:
    """``work(job)`` for all jobs, at most ``workers`` at a time, as they end; None whenever ``poll_s`` went by without one.

    A job that raises, or whose process is killed, doesn't touch the others. Workers leave Ctrl-C to their parent; when the
    iterator is closed, they are ended. In them BLAS gives the same bits on every x86 processor with AVX2.
    """
    context = multiprocessing.get_context("spawn")
    threads = max(1, (os.cpu_count() or 1) // max(1, min(workers, len(jobs))))
    waiting, running = deque(jobs), dict[Connection, tuple[SpawnProcess, J]]()
    try:
        while waiting or running:
            while waiting and len(running) < workers:
                job = waiting.popleft()
                receiving, sending = context.Pipe(duplex=False)
                process = context.Process(target=_run, args=(work, job, sending, threads), daemon=True)
                with _environment(_SAME_SUMS):  # libraries read it when they are loaded, and here they are
                    process.start()
                sending.close()  # so that its end is seen here when the process dies
                running[receiving] = process, job
            ready = wait(list(running), poll_s)
            if not ready:
                yield None
            for receiving in [r for r in running if r in ready]:
                process, job = running[receiving]
                try:
                    result, error = receiving.recv()
                    process.join()
                except EOFError:
                    process.join()
                    result, error = None, f"its process died ({_how(process.exitcode)})"
                del running[receiving]
                receiving.close()
                yield JobResult(job, result, error)
    finally:
        for process, _ in running.values():
            process.terminate()
        for receiving, (process, _) in running.items():
            process.join()
            receiving.close()


def _run(work: Callable[[J], R], job: J, sending: Connection, threads: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    use_threads(threads)
    try:
        said: tuple[R | None, str] = work(job), ""
    except SurveilNavError as error:
        said = None, str(error)
    except Exception:  # whatever it is, whoever asked must hear of it
        said = None, traceback.format_exc()
    sending.send(said)


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """What processes that start meanwhile inherit."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _how(exitcode: int | None) -> str:
    if exitcode is not None and exitcode < 0:
        return f"killed by {signal.Signals(-exitcode).name}"
    return f"exit code {exitcode}"
