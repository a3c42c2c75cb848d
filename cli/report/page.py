"""``report.html``: one file. Pictures are inside, nothing is loaded from elsewhere, and one script runs: the film strip's."""

from __future__ import annotations

import base64
import hashlib
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from surveilnav.cli.report.facts import facts_of
from surveilnav.cli.report.record import RunRecord
from surveilnav.cli.words import human_bytes

_TEMPLATE = "report.html.j2"


def write_report(record: RunRecord, path: Path) -> None:
    """Writes the report; its folder must exist. A stretch of data that can't be drawn is left out and said so."""
    # Names on the bus are hostile: every text is escaped, but for drawings that escape their own.
    templates = Environment(
        loader=PackageLoader("surveilnav.cli"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["bytes"] = human_bytes
    script = _text_of(templates, "film.js")
    html = templates.get_template(_TEMPLATE).render(
        facts_of(record), script=Markup(script), style=Markup(_text_of(templates, "report.css")), policy=_policy(script)
    )
    path.write_text(html, encoding="utf-8")


def _text_of(templates: Environment, name: str) -> str:
    assert templates.loader is not None
    return templates.loader.get_source(templates, name)[0]


def _policy(script: str) -> str:
    """What the page may do: show pictures that it holds, run this one script. Whatever slipped in could load or send nothing."""
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    return (
        f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'; base-uri 'none'; "
        "form-action 'none'"
    )
