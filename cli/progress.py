"""Progress with time left, on stderr."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
    TransferSpeedColumn,
)

from surveilnav.cli.words import duration

_SAY_EVERY_S = 15.0


@contextmanager
def bar(console: Console) -> Iterator[Callable[[float, str], None]]:
    """A function (fraction 0-1, what is done) that moves a progress bar; lines where there is no terminal. Each kind of work
    (what is said before a parenthesis) has a fraction and a time of its own."""
    if not console.is_terminal:
        yield _Told(console).say
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task, kind = progress.add_task("", total=1.0), ""

        def move(fraction: float, what: str) -> None:
            """Another kind of work begins a bar of its own: the pace of the last one says nothing of it."""
            nonlocal kind
            if _kind(what) != kind:
                kind = _kind(what)
                progress.reset(task)
            progress.update(task, completed=fraction, description=what)

        yield move


def _kind(what: str) -> str:
    return what.partition(" (")[0]


class _Told:
    """Progress for a file: a line for each kind of work, and every now and then how long it will take."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._kind, self._began_s, self._said_s, self._first = "", 0.0, 0.0, 0.0

    def say(self, fraction: float, what: str) -> None:
        """What is done now, and how much of it [0-1]."""
        now_s = time.monotonic()
        if _kind(what) != self._kind:
            self._kind, self._began_s, self._said_s, self._first = _kind(what), now_s, now_s, fraction
            self._console.print(f"  {self._kind} ...", markup=False)
        elif now_s - self._said_s >= _SAY_EVERY_S and fraction > self._first:
            self._said_s = now_s
            left_s = (now_s - self._began_s) / (fraction - self._first) * (1.0 - fraction)
            self._console.print(f"  {what}: {100 * fraction:.0f} %, {duration(left_s)} left", markup=False)


@contextmanager
def counting(console: Console, things: str) -> Iterator[Callable[[int, int, str], None]]:
    """A function (done, of, which) for long work: a bar, or a line every now and then where there is no terminal."""
    if console.is_terminal:
        columns = (
            TextColumn(things),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.description}"),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=console, transient=True) as progress:
            task = progress.add_task("", total=None)
            yield lambda done, of, which: progress.update(task, completed=done, total=of, description=which)
        return
    began_s = said_s = time.monotonic()
    first: int | None = None

    def say(done: int, of: int, which: str) -> None:
        """A line every ``_SAY_EVERY_S``, and the last one."""
        nonlocal said_s, first
        first = done if first is None else first
        now_s = time.monotonic()
        if now_s - said_s < _SAY_EVERY_S and done < of:
            return
        said_s = now_s
        left_s = (now_s - began_s) / (done - first) * (of - done) if done > first else 0.0
        left = f", {duration(left_s)} left" if left_s else ""
        console.print(f"  {done} of {of} {things}{left} {which}".rstrip())

    yield say


@contextmanager
def downloading(console: Console) -> Iterator[Callable[[int, int | None, str], None]]:
    """A function (bytes so far, of, file) for downloads: a bar for each file, or a line where there is no terminal."""
    if console.is_terminal:
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            DownloadColumn(),
            TransferSpeedColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=console) as progress:
            tasks: dict[str, TaskID] = {}

            def move(done: int, of: int | None, file: str) -> None:
                """Moves the file's bar, which is made on its first bytes."""
                if file not in tasks:
                    tasks[file] = progress.add_task(file, total=of)
                progress.update(tasks[file], completed=done, total=of)

            yield move
        return
    said: set[str] = set()

    def say(done: int, of: int | None, file: str) -> None:
        """A line for each file."""
        if file not in said:
            said.add(file)
            console.print(f"  {file}{f' ({of / 1e6:,.1f} MB)' if of else ''} ...")

    yield say
