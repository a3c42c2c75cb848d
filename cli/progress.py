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

_SAY_EVERY_S = 15.0


@contextmanager
def bar(console: Console) -> Iterator[Callable[[float, str], None]]:
    """A function (fraction 0-1, what is done) that moves a progress bar; plain lines where there is no terminal."""
    if not console.is_terminal:
        said: set[str] = set()

        def say(fraction: float, what: str) -> None:
            """A line for each kind of work."""
            if what not in said:
                said.add(what)
                console.print(f"  {what} ...")

        yield say
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=1.0)
        yield lambda fraction, what: progress.update(task, completed=fraction, description=what)


@contextmanager
def counting(console: Console, things: str) -> Iterator[Callable[[int, int, str], None]]:
    """A function (done, of, which) for long work: a bar, or a line every now and then where there is no terminal."""
    if console.is_terminal:
        columns = (TextColumn(things), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"),
                   TimeElapsedColumn(), TimeRemainingColumn())  # fmt: skip
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
        left = f", {(now_s - began_s) / (done - first) * (of - done) / 60:.0f} min left" if done > first else ""
        console.print(f"  {done} of {of} {things}{left} {which}".rstrip())

    yield say


@contextmanager
def downloading(console: Console) -> Iterator[Callable[[int, int | None, str], None]]:
    """A function (bytes so far, of, file) for downloads: a bar for each file, or a line where there is no terminal."""
    if console.is_terminal:
        columns = (TextColumn("{task.description}"), BarColumn(), DownloadColumn(), TransferSpeedColumn(),
                   TimeRemainingColumn())  # fmt: skip
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
