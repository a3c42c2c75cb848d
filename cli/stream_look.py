"""Looks at the streams of cameras, all at once and none for longer than its deadline."""

from __future__ import annotations

import os
import queue
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from surveilnav.errors import ConfigError
from surveilnav.services.camera_node.core.stream_health import FrameStatistics
from surveilnav.services.camera_node.sources.readers.choose import choose_reader
from surveilnav.services.camera_node.sources.readers.reader import StreamError

T = TypeVar("T")

#: Opening takes a reader up to 6 s and finding out why it failed 3 s more (services/camera_node/sources/readers).
DEADLINE_S = 20.0
_FIRST_S = 10.0


@dataclass(frozen=True, slots=True)
class Look:
    """What came from a stream. ``problem``: why nothing did, or what is wrong with its pictures, for people; empty: nothing.

    Attributes:
        size_px: (width, height) of its pictures; (0, 0): none came.
        hz: pictures a second; 0: fewer than two came.
    """

    size_px: tuple[int, int] = (0, 0)
    hz: float = 0.0
    problem: str = ""


def look(stream: str, folder: Path, seconds: float) -> Look:
    """Opens a stream as cameras.yaml names it, waits for a picture, and counts those of ``seconds`` more."""
    try:
        reader = choose_reader(stream, folder, os.environ, (0, 0), 0.0)
    except ConfigError as error:
        return Look(problem=str(error).removeprefix("stream: "))
    try:
        reader.open()
        first, until_s = None, time.monotonic() + _FIRST_S
        while first is None and time.monotonic() < until_s:
            first = reader.read()
        if first is None:
            return Look(problem=f"no picture has come within {_FIRST_S:.0f} s")
        began_s, n, hz = time.monotonic(), 0, 0.0
        while time.monotonic() < began_s + seconds:
            if reader.read() is not None:
                n += 1
                hz = n / max(1e-3, time.monotonic() - began_s)
        height, width = first.rgb.shape[:2]
        return Look((width, height), hz, FrameStatistics.from_picture(first.rgb).fault)
    except StreamError as error:
        return Look(problem=str(error))
    finally:
        reader.close()


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
