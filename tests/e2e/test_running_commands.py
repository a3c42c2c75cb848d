"""Commands on a running system: `watch` in a terminal of 80 x 24, and what people do wrong."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import threading
from pathlib import Path

import pytest

from tests.waiting import until

ROOT = Path(__file__).parents[2]
_LEAVES_THE_SCREEN = b"\x1b[?1049l"


class Screen:
    """A program in a terminal; what it shows now."""

    def __init__(self, command: list[str], rows: int, columns: int) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        variables = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES", "NO_COLOR")}
        self.process = subprocess.Popen(
            command,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            cwd=ROOT,
            env=variables | {"TERM": "xterm-256color"},
            start_new_session=True,
        )
        os.close(slave)
        self.written = b""
        self._reading = threading.Thread(target=self._read, daemon=True)
        self._reading.start()

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._master, 65536)
            except OSError:  # the other end is closed
                return
            if not data:
                return
            self.written += data

    def lines(self) -> list[str]:
        """The last whole picture."""
        frames = self.written.decode(errors="replace").split("\x1b[H")
        picture = frames[-2] if len(frames) > 1 else ""
        return [line.rstrip() for line in re.sub(r"\x1b\[[0-9;?]*[a-zA-Z]", "", picture).splitlines()]

    def shows(self, text: str) -> bool:
        return any(text in line for line in self.lines())

    def end(self) -> int:
        """Ctrl-C; the exit status."""
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(30)
        self._reading.join(5)
        return code


@pytest.mark.slow
def test_the_screen_outlives_the_gateway_and_ends_by_ctrl_c(flat):
    url = f"http://127.0.0.1:{flat.gateway_port}"
    screen = Screen([sys.executable, "-m", "surveilnav.cli.main", "watch", "--url", url], rows=24, columns=80)
    try:
        until(lambda: screen.shows("c0-1"), screen.lines, 60.0)
        assert [line for line in screen.lines() if len(line) > 80] == []
        flat.kill("gateway")
        until(lambda: screen.shows("! the gateway doesn't answer, since "), screen.lines, 60.0)
        assert screen.shows("c0-1"), "what was known stays"
        flat.stack.start("gateway")
        until(lambda: not screen.shows("the gateway doesn't answer"), screen.lines, 60.0)
        until(lambda: screen.shows("what came before isn't known: "), screen.lines, 60.0)
    finally:
        code = screen.end()
    assert code == 0
    assert _LEAVES_THE_SCREEN in screen.written
    assert b"Traceback" not in screen.written


@pytest.mark.slow
def test_in_a_pipe_it_is_a_line_an_event(running):
    command = [
        sys.executable,
        "-m",
        "surveilnav.cli.main",
        "watch",
        "--url",
        f"http://127.0.0.1:{running.gateway_port}",
        "--json",
    ]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as watching:
        assert watching.stdout is not None
        assert watching.stderr is not None
        first = json.loads(watching.stdout.readline())
        assert (first["event"], set(first["data"])) == ("reset", {"why", "do"}), "as the gateway sent it"
        watching.stdout.close()  # as `head -1` does
        running.search("tv", mission="heard")
        until(lambda: watching.poll() is not None, "it never noticed", 60.0)
        assert (watching.returncode, watching.stderr.read()) == (1, "")


@pytest.mark.slow
def test_what_cant_be_is_refused_with_what_to_do(running):
    def surveilnav(*arguments):
        command = [
            sys.executable,
            "-m",
            "surveilnav.cli.main",
            *arguments,
            "--json",
            "--url",
            f"http://127.0.0.1:{running.gateway_port}",
        ]
        run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=100, check=False)
        assert "Traceback" not in run.stderr
        told = json.loads(run.stdout)
        return run.returncode, told.get("error") or told.get("state"), run.stderr

    running.search("bed", mission="one-robot")
    assert surveilnav("missions", "pause", "one-rob")[:2] == (0, "paused")  # so that it can't end meanwhile
    code, error, said = surveilnav("find", "tv", "--robot", "r1")
    assert (code, error["name"], "r1" in said) == (1, "robot_busy", True)
    code, error, said = surveilnav("find", "tv", "--robot", "nobody")
    assert (code, error["name"], "nobody" in said) == (1, "unknown_robot", True)
    assert surveilnav("missions", "cancel", "one-robot")[:2] == (0, "cancelled")
    code, error, said = surveilnav("missions", "cancel", "one-robot")
    assert (code, error["name"]) == (1, "finished")
