"""Probes the streams of cameras, all at once and none for longer than its deadline.

Each is opened in a process of its own (``python -m surveilnav.cli.stream_probe``): OpenCV opens one stream after the other, so
that eight cameras that are off would take a minute, and a decoder that hangs can't be ended otherwise.
"""

from __future__ import annotations

import json
import math
import os
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import TypeVar

import httpx

from surveilnav.cameras_file.passwords import passwords_in
from surveilnav.cameras_file.urls import with_secrets
from surveilnav.errors import ConfigError
from surveilnav.services.camera_node.core.stream_health import FrameStatistics
from surveilnav.services.camera_node.sources.readers.choose import choose_reader
from surveilnav.services.camera_node.sources.readers.reader import FrameReader, StreamError
from surveilnav.services.camera_node.sources.readers.rtsp import ask

T = TypeVar("T")

#: Opening takes a reader up to 6 s and finding out why it failed 3 s more (services/camera_node/sources/readers).
PROBE_S = 20.0
#: So many streams are decoded at once.
_AT_ONCE = 8
_PROCESSES = threading.BoundedSemaphore(_AT_ONCE)
_FIRST_S = 10.0
_CLOCK_S = 3.0
_FAULTS = {
    "": "",
    "black": "its picture is black: is the lens covered, or is there no light?",
    "grey": "its picture is all grey, as decoders show what they can't decode: restart the camera",
    "garbled": "much of its picture is flat blocks, as after lost packets: check its network",
}


@dataclass(frozen=True, slots=True)
class ProbeResult:
    """What came from a stream. ``problem``: why nothing did, or what is wrong with its pictures, for people; empty: nothing.

    Attributes:
        size_px: (width, height) of its pictures; (0, 0): none came.
        hz: pictures a second; 0: fewer than two came.
    """

    size_px: tuple[int, int] = (0, 0)
    hz: float = 0.0
    problem: str = ""


def probe(stream: str, folder: Path, seconds: float) -> ProbeResult:
    """Opens a stream as cameras.yaml names it, waits for a picture, and counts those of ``seconds`` more."""
    if problem := _unreachable(stream, folder):
        return ProbeResult(problem=problem)  # without a process, and sooner
    asked = json.dumps({"stream": stream, "folder": str(folder), "seconds": seconds})  # by a pipe: others see arguments
    command = [sys.executable, "-m", "surveilnav.cli.stream_probe"]
    try:
        with _PROCESSES:
            done = subprocess.run(command, input=asked, capture_output=True, text=True, timeout=PROBE_S, check=False)
        told = json.loads(done.stdout.splitlines()[-1])
        return ProbeResult((told["width_px"], told["height_px"]), told["hz"], told["problem"])
    except subprocess.TimeoutExpired:
        return ProbeResult(problem=f"no picture has come within {PROBE_S:.0f} s")
    except (IndexError, ValueError):
        return ProbeResult(problem="the decoder crashed")


def deadline_s(n_streams: int) -> float:
    """After so long all of ``n_streams`` have been probed, or never will be."""
    return 10.0 + PROBE_S * max(1, math.ceil(n_streams / _AT_ONCE))


def _unreachable(stream: str, folder: Path) -> str:
    """Why an RTSP server doesn't answer, or why the address can't be used; empty: it does, or it is another stream."""
    try:
        address = _address(stream, folder)
    except ValueError as error:
        return str(error)
    return ask(address)[1] if address.lower().startswith(("rtsp://", "rtsps://")) else ""


def _address(stream: str, folder: Path) -> str:
    return with_secrets(stream, passwords_in(folder) | dict(os.environ))


def probe_here(stream: str, folder: Path, seconds: float) -> ProbeResult:
    """The same as ``probe``, in this process."""
    try:
        reader = choose_reader(stream, folder, os.environ, (0, 0), 0.0)
    except ConfigError as error:
        return ProbeResult(problem=str(error).removeprefix("stream: "))
    try:
        reader.open()
        first, until_s = None, time.monotonic() + _FIRST_S
        while first is None and time.monotonic() < until_s:
            first = reader.read()
        if first is None:
            return ProbeResult(problem=f"no picture has come within {_FIRST_S:.0f} s")
        hz = _rate_hz(reader, seconds)
        height, width = first.rgb.shape[:2]
        return ProbeResult((width, height), hz, _FAULTS[FrameStatistics.from_picture(first.rgb).fault])
    except StreamError as error:
        return ProbeResult(problem=str(error))
    except Exception as error:  # of a decoder; its text may hold the address
        return ProbeResult(problem=f"{type(error).__name__} in the decoder")
    finally:
        reader.close()


def _rate_hz(reader: FrameReader, seconds: float) -> float:
    n, began_s = 0, time.monotonic()
    while (now_s := time.monotonic()) < began_s + seconds:
        n += reader.read() is not None
    return n / (now_s - began_s) if seconds else 0.0


def clock_offset_s(stream: str, folder: Path) -> float | None:
    """How far a network camera's clock is ahead, by the date in its answer; None if it isn't asked or doesn't say."""
    try:
        address = _address(stream, folder)
        before_s = time.time()
        if address.startswith(("rtsp://", "rtsps://")):
            lines = ask(address)[0].split("\r\n")
            date = next((line.partition(":")[2] for line in lines if line.lower().startswith("date:")), "")
        elif address.startswith(("http://", "https://")):
            with httpx.stream("GET", address, timeout=_CLOCK_S, verify=False) as answer:
                date = answer.headers.get("date", "")
        else:
            return None
        # The answer has whole seconds, which are half a second old in the mean.
        return parsedate_to_datetime(date.strip()).timestamp() + 0.5 - (before_s + time.time()) / 2
    except (OSError, ValueError, httpx.HTTPError, httpx.InvalidURL):
        return None


def at_once(
    tasks: Mapping[str, Callable[[], T]],
    deadline_s: float,
    late: Callable[[str], T],
    on_done: Callable[[str], None] = lambda name: None,
) -> dict[str, T]:
    """The results of all tasks, each on a thread of its own, in the tasks' order.

    A task that isn't done after ``deadline_s`` is left behind on its thread, which ends with the process; ``late`` stands in.
    What a task raises, this raises.
    """
    done: queue.Queue[tuple[str, T | BaseException]] = queue.Queue()

    def run(name: str, task: Callable[[], T]) -> None:
        try:
            done.put((name, task()))
        except BaseException as error:
            done.put((name, error))

    for name, task in tasks.items():
        threading.Thread(target=run, args=(name, task), name=name, daemon=True).start()
    results: dict[str, T] = {}
    until_s = time.monotonic() + deadline_s
    while len(results) < len(tasks):
        try:
            name, result = done.get(timeout=max(0.0, until_s - time.monotonic()))
        except queue.Empty:
            break
        if isinstance(result, BaseException):
            raise result
        results[name] = result
        on_done(name)
    return {name: results[name] if name in results else late(name) for name in tasks}


def main() -> None:
    """Probes the stream that standard input names, and prints what came from it."""
    asked = json.load(sys.stdin)
    result = probe_here(asked["stream"], Path(asked["folder"]), asked["seconds"])
    width_px, height_px = result.size_px
    print(json.dumps({"width_px": width_px, "height_px": height_px, "hz": result.hz, "problem": result.problem}))


if __name__ == "__main__":
    main()
