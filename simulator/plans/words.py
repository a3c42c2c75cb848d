"""Words by which people name roofs, and doors that stay shut: ``data/doors_and_roofs.json``."""

from __future__ import annotations

import json
import re
from importlib import resources

from surveilnav.nouns import split_camel_case

_WORDS: dict[str, list[str]] = json.loads(
    resources.files("surveilnav.simulator.plans").joinpath("data/doors_and_roofs.json").read_text("utf-8")
)
#: From here on scripts put no spaces between words.
_SPACELESS = "\u2e80"


def words_of(*names: str) -> str:
    """Names as single words: "eTeks#frontDoor2" is "e Teks front Door"."""
    return " ".join(re.sub(r"[\W\d_]+", " ", split_camel_case(" ".join(names))).split())


def _any_of(words: list[str]) -> re.Pattern[str]:
    """Matches any of the words, or what begins like those that end in a hyphen."""
    edged = (
        re.escape(word)
        if word[0] >= _SPACELESS
        else rf"\b{re.escape(word.removesuffix('-'))}" + r"\b" * (word[-1] != "-")
        for word in words
    )
    return re.compile("|".join(edged), re.IGNORECASE)


#: In the name of a level that is a roof.
ROOF = _any_of(_WORDS["roof"])
#: In the words of a door that is made to lead out of the home (``words_of`` its name and catalogue id).
OUTER = _any_of(_WORDS["outer"])
#: In those of a door that stays shut wherever it is: of a garage, a lift.
SHUT = _any_of(_WORDS["shut"])
