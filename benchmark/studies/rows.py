"""The rows that a study has measured so far, one JSON object a line. A second start measures only what is missing."""

from __future__ import annotations

import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from surveilnav.benchmark import journal


@dataclass(frozen=True, slots=True)
class RowsFile:
    """A study's file of rows. Safe for several processes at once; a kill loses no row that was appended.

    ``key``: the fields that tell one row from another. Methods raise OSError as the disk does.
    """

    path: Path
    key: tuple[str, ...]

    def append(self, row: Mapping[str, Any]) -> None:
        journal.append(self.path, json.dumps(row))

    def load(self) -> list[dict[str, Any]]:
        """All rows so far, without lines that can't be read."""
        rows = []
        for line in journal.lines(self.path) if self.path.exists() else []:
            with suppress(json.JSONDecodeError):
                rows.append(json.loads(line))
        return rows

    def key_of(self, row: Mapping[str, Any]) -> tuple[Any, ...]:
        """The fields of a row that tell it from others."""
        return tuple(row[name] for name in self.key)

    def done(self) -> frozenset[tuple[Any, ...]]:
        """The keys of all rows."""
        return frozenset(self.key_of(row) for row in self.load())
