"""``report.html``, one file. The gateway's page shows the map, the film and the objects in it, fed with what was recorded."""

from __future__ import annotations

import base64
import hashlib
import json
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from surveilnav.cli.report import page_code
from surveilnav.cli.report.facts import facts_of
from surveilnav.cli.report.film import film_of
from surveilnav.cli.report.key_moments import key_moments
from surveilnav.cli.report.record import RunRecord
from surveilnav.cli.words import human_bytes


def write_report(record: RunRecord, path: Path) -> None:
    """Writes the report; its folder must exist. Data that can't be shown (a picture that doesn't decode, a place that is no
    number) is left out."""
    # Names on the bus are hostile, so every text is escaped.
    templates = Environment(
        loader=PackageLoader("surveilnav.cli"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {"bytes": human_bytes, "base64": lambda data: base64.b64encode(data).decode()}
    script = page_code.script(_text_of(templates, "report.js"))
    film = film_of(record)
    moments = key_moments(film, record.target) if film else []
    html = templates.get_template("report.html.j2").render(
        facts_of(record),
        moments=moments,
        data=_json(film.data(record) | {"moments": [[m.frame, m.title] for m in moments]}) if film else "",
        script=Markup(script),
        style=Markup(page_code.styles() + _text_of(templates, "report.css")),
        policy=_policy(script),
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


def _json(data: object) -> Markup:
    """As a script element may hold it: no text in it can end the element."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e"))
