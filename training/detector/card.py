"""The model card of ``compact``: ``data/card.md.j2``, filled with the numbers that lie beside its weights in the package.

    python -m training.detector.card > docs/understand/compact.md

``python -m training.detector.export`` writes ``card.json`` beside the weights, ``evaluate --card`` adds what they find.
"""

from __future__ import annotations

from pathlib import Path

import jinja2

from surveilnav.perception import models
from surveilnav.perception.models.card import Card
from surveilnav.simulator.world.labels import TARGETS
from training.detector import classes

_TEMPLATE = Path(__file__).parent / "data" / "card.md.j2"


def page(card: Card | None) -> str:
    """The page in Markdown. Without a card it says that there are no weights yet."""
    measured = card.measured if card else {}
    kinds = {kind: measured[kind] for kind in ("robot", "camera") if kind in measured}
    rows = dict.fromkeys([*TARGETS, *(name for found in kinds.values() for name in found.by_class)])
    environment = jinja2.Environment(
        trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True, undefined=jinja2.StrictUndefined
    )
    template = environment.from_string(_TEMPLATE.read_text("utf-8"))
    return template.render(card=card, names=classes.load(), kinds=kinds, rows=rows)


def main() -> None:
    path = models.model_called("compact").built_in_path
    print(page(models.card_of(path) if path.exists() else None), end="")


if __name__ == "__main__":
    main()
