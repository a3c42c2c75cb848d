"""What `surveilnav doctor` says of one thing."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    from rich.console import Console

Level = Literal["ok", "note", "problem"]
_MARKS: dict[Level, tuple[str, str]] = {
    "ok": ("ok     ", "green"),
    "note": ("note   ", "yellow"),
    "problem": ("problem", "red"),
}


@dataclass(frozen=True)
class Finding:
    """One thing looked at. ``level``: ok, note (works without it, less well), problem (must be mended)."""

    what: str
    level: Level
    detail: str
    remedy: str = ""

    def as_dict(self) -> dict[str, Any]:
        """As ``--json`` says it."""
        return asdict(self)


def show(findings: list[Finding], console: Console) -> None:
    """A line a finding."""
    for finding in findings:
        mark, style = _MARKS[finding.level]
        remedy = f"  -> {finding.remedy}" if finding.remedy else ""
        console.print(mark, style=style, markup=False, end=" ")
        console.print(f"{finding.what}: {finding.detail}{remedy}", markup=False, soft_wrap=True)
