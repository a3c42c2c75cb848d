"""How a service's process begins, and ends with whoever started it."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
import structlog

from surveilnav.bus.main import ENDS_WITH_STDIN, run_warm_up

_PROGRAM = """
import sys, time
from surveilnav.bus.main import run_service
def main():
    print("up", flush=True)
    time.sleep(60)
sys.exit(run_service(main))
"""


@pytest.mark.parametrize("told", [True, False])
def test_a_service_ends_when_its_standard_input_is_closed_if_it_was_told_so(told):
    environment = {**os.environ, ENDS_WITH_STDIN: "1" if told else ""}
    with subprocess.Popen(
        [sys.executable, "-c", _PROGRAM], env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as service:
        assert service.stdin
        assert service.stdout
        assert service.stdout.readline() == "up\n"
        service.stdin.close()
        try:
            code = service.wait(3.0 if told else 1.0)
        except subprocess.TimeoutExpired:
            code = None
            service.kill()
    assert code == (0 if told else None)


def test_a_service_that_ends_does_not_look_through_all_objects_once_more():
    program = """
import atexit, gc, sys
from surveilnav.bus.main import run_service
atexit.register(lambda: print(gc.get_freeze_count() > 1000))
sys.exit(run_service(lambda: None))
"""
    ended = subprocess.run([sys.executable, "-c", program], check=True, capture_output=True, text=True)
    assert ended.stdout == "True\n"


def test_a_warm_up_that_fails_keeps_no_service_from_starting():
    def warm_up():
        raise ZeroDivisionError("no room")

    with structlog.testing.capture_logs() as said:
        run_warm_up(warm_up)
        run_warm_up(lambda: None)
    assert [line["log_level"] for line in said] == ["info", "warning", "info", "info"]
    assert said[1]["why"] == "ZeroDivisionError: no room"


_LOGS = """
import contextlib, io, structlog
from surveilnav.bus import logs
log = structlog.get_logger()
with io.StringIO() as for_a_while:
    with contextlib.redirect_stderr(for_a_while):
        logs.configure()
        log.info("first")
    assert "first" in for_a_while.getvalue()
log.info("second")
structlog.get_logger().info("third")
"""


def test_who_sets_logging_up_while_stderr_is_redirected_can_log_afterwards():
    ended = subprocess.run([sys.executable, "-c", _LOGS], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "second" in ended.stderr
    assert "third" in ended.stderr
