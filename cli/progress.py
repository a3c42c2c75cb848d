"""Progress with time left, on stderr."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn


@contextmanager
def bar(console: Console) -> Iterator[Callable[[float, str], None]]:
    """A function (fraction 0-1, what is done) that moves a progress bar; plain lines where there is no terminal."""
    if not console.is_terminal:
        said: set[str] = set()

        def say(fraction: float, what: str) -> None:
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
