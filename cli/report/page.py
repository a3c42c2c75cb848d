"""``report.html``: one file. Pictures are inside, nothing is loaded from elsewhere, no script runs."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from cli.report.facts import facts_of
from cli.report.record import RunRecord
from cli.words import human_bytes

_TEMPLATE = "report.html.j2"


def write_report(record: RunRecord, path: Path) -> None:
    """Writes the report; its folder must exist. A stretch of data that can't be drawn is left out and said so."""
    # Names on the bus are hostile: every text is escaped, but for drawings that escape their own.
    templates = Environment(
        loader=PackageLoader("cli"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    templates.filters["bytes"] = human_bytes
    path.write_text(templates.get_template(_TEMPLATE).render(facts_of(record)), encoding="utf-8")
