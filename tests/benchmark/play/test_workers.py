"""Jobs in processes of their own: whatever happens to one is said, and the others are done."""

from __future__ import annotations

import os
import platform
import signal
import sys
import time

import pytest
from threadpoolctl import threadpool_info

from surveilnav.benchmark.play.workers import in_workers
from surveilnav.errors import ConfigError


def _job(what):
    if what == "raises":
        raise ZeroDivisionError("a bug")
    if what == "refuses":
        raise ConfigError("take another")
    if what == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "exits":
        sys.exit(3)
    if what == "sleeps":
        time.sleep(600.0)
    return f"{what}, done"


def test_what_happens_to_one_job_is_said_and_the_others_are_done():
    ended = {
        d.job: d for d in in_workers(_job, ["one", "raises", "refuses", "killed", "two", "exits", "three"], 2) if d
    }
    assert {job: d.result for job, d in ended.items() if not d.error} == {
        "one": "one, done",
        "two": "two, done",
        "three": "three, done",
    }
    assert "ZeroDivisionError: a bug" in ended["raises"].error
    assert ended["raises"].why == "ZeroDivisionError: a bug"
    assert ended["refuses"].error == ended["refuses"].why == "take another"
    assert ended["one"].why == ""
    assert ended["killed"].error == "its process died (killed by SIGKILL)"
    assert ended["exits"].error == "its process died (exit code 3)"


def test_while_nothing_ends_it_says_so_and_closing_ends_the_workers():
    ended = in_workers(_job, ["sleeps"], 1, 0.05)
    assert next(ended) is None
    began_s = time.monotonic()
    ended.close()
    assert time.monotonic() - began_s < 60.0  # the job sleeps ten minutes


def test_no_jobs_no_workers():
    assert list(in_workers(_job, [], 2)) == []


def _blas(_):
    import numpy  # noqa: F401 - brings OpenBLAS, as whatever a job imports does

    return {(lib["architecture"], lib["num_threads"]) for lib in threadpool_info() if lib["internal_api"] == "openblas"}


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="kernels are chosen by name on x86 only")
def test_sums_are_the_same_on_every_x86_processor_and_any_number_of_cores(monkeypatch):
    monkeypatch.setenv("OPENBLAS_CORETYPE", "Nehalem")
    monkeypatch.delenv("OPENBLAS_NUM_THREADS", raising=False)
    (done,) = (d for d in in_workers(_blas, [0], 1) if d)
    assert done.result == {("Haswell", 1)}, done.error
    assert os.environ["OPENBLAS_CORETYPE"] == "Nehalem"
    assert "OPENBLAS_NUM_THREADS" not in os.environ
