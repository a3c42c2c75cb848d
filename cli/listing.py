"""Lists of things: a table that fits the terminal, with ids whole; where nobody looks, a line for each thing."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from rich.cells import cell_len
from rich.console import Console
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from surveilnav.cli.terminal import plain

_GAP = 2
#: Columns are narrowed to no less than this.
_LEAST = {"id": 10, "word": 10, "text": 12}

Kind = Literal["id", "number", "word", "text", "note"]
Cell = str | tuple[str, str]
"""A text, or a text and its style. It is shown as it is: whatever it holds, nothing of it is obeyed."""


@dataclass(frozen=True, slots=True)
class Column:
    """``cell``: what it shows of a thing. A ``number`` is never broken; ``id``, ``word`` and ``text`` are folded where room is
    short, never cut. A ``note`` is the last column: where it doesn't fit beside the others it stands below them."""

    title: str
    cell: Callable[[Any], Cell]
    kind: Kind = "word"


def listing(console: Console, columns: Sequence[Column], things: Iterable[Any]) -> None:
    """Prints a table as wide as the terminal; for a file or a program, a line for each thing, however long."""
    texts = [[_text((column.title, "bold")) for column in columns]]
    texts += [[_text(column.cell(thing)) for column in columns] for thing in things]
    widths = [max(cell_len(row[i].plain) for row in texts) for i in range(len(columns))]
    if not console.is_terminal:
        for row in texts:
            cells = (
                _aligned(text.plain.replace("\n", " "), c, w) for text, c, w in zip(row, columns, widths, strict=True)
            )
            console.print("  ".join(cells).rstrip(), markup=False, soft_wrap=True)
        return
    below = columns[-1].kind == "note" and _total(widths) > console.width
    beside = len(columns) - below
    narrowed = _narrowed(columns[:beside], widths[:beside], console.width)
    for number, row in enumerate(texts):
        console.print(_line(columns, row[:beside], narrowed))
        if below and number and row[-1]:
            console.print(Padding(row[-1], (0, 0, 0, _GAP)))


def _line(columns: Sequence[Column], row: Sequence[Text], widths: Sequence[int]) -> Table:
    line = Table.grid(padding=(0, _GAP, 0, 0), pad_edge=False)
    for column, width in zip(columns, widths, strict=False):
        line.add_column(justify="right" if column.kind == "number" else "left", width=width, overflow="fold")
    line.add_row(*row)
    return line


def _aligned(text: str, column: Column, width: int) -> str:
    room = " " * (width - cell_len(text))
    return room + text if column.kind == "number" else text + room


def _total(widths: Sequence[int]) -> int:
    return sum(widths) + _GAP * (len(widths) - 1)


def _narrowed(columns: Sequence[Column], widths: Sequence[int], most: int) -> list[int]:
    """The widths of columns that fit in ``most`` together: the widest that may be folded give way."""
    found = list(widths)
    least = [min(width, _LEAST.get(column.kind, width)) for column, width in zip(columns, widths, strict=True)]
    while _total(found) > most:
        widest = max((i for i in range(len(found)) if found[i] > least[i]), key=lambda i: found[i], default=None)
        if widest is None:
            break
        found[widest] -= 1
    return found


def _text(cell: Cell) -> Text:
    text, style = (cell, "") if isinstance(cell, str) else cell
    return Text(plain(text), style=style)


def facts(console: Console, rows: Iterable[tuple[str, Cell]]) -> None:
    """Prints what there is to say of one thing: a line a fact; empty ones are left out."""
    table = Table.grid(padding=(0, _GAP, 0, 0), pad_edge=False)
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, cell in rows:
        if _text(cell).plain:
            table.add_row(Text(name, style="dim"), _text(cell))
    console.print(table)
