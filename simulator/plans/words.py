"""Words by which people name roofs, and doors that stay shut: ``data/doors_and_roofs.json``."""

from __future__ import annotations

import json
import re
from importlib import resources

_WORDS: dict[str, list[str]] = json.loads(
    resources.files("simulator.plans").joinpath("data/doors_and_roofs.json").read_text("utf-8")
)


def _any_of(words: list[str], *, alone: bool) -> re.Pattern[str]:
    """Matches any of the words; ``alone`` wants no letter beside them, where a language puts spaces between words."""
    edge = [rf"\b{re.escape(word)}\b" if alone and word[0] < "\u2e80" else re.escape(word) for word in words]
    return re.compile("|".join(edge), re.IGNORECASE)


#: In the name of a level that is a roof.
ROOF = _any_of(_WORDS["roof"], alone=True)
#: In the name or catalogue id of a door that is made to lead out of the home.
OUTER = _any_of(_WORDS["outer"], alone=False)
#: In those of a door that stays shut wherever it is: of a garage, a lift.
SHUT = _any_of(_WORDS["shut"], alone=False)
