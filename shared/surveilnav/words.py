"""Canonical spelling and validation of words for objects."""

from __future__ import annotations

import json
import unicodedata
from functools import cache
from pathlib import Path

from surveilnav.errors import TargetError

#: Limits on the length of a word, and on the number of words in a request.
MAX_WORD_CHARS, MAX_WORDS = 100, 256


def canonical(name: str) -> str:
    """The canonical spelling of a word: lower case, single spaces, synonyms replaced ("Sofa" -> "couch")."""
    folded = " ".join(unicodedata.normalize("NFC", name).strip().lower().replace("_", " ").replace("-", " ").split())
    return _synonyms().get(folded, folded)


def validate_word(name: str) -> str:
    """The canonical spelling of a word that can name an object: a short phrase in any language.

    Raises:
        TargetError: it is empty, too long, or contains characters that no word has.
    """
    if len(name) > 4 * MAX_WORD_CHARS or len(word := canonical(name)) > MAX_WORD_CHARS:
        raise TargetError(f"a target is a phrase of up to {MAX_WORD_CHARS} characters, got {len(name)}")
    if not word.isprintable():
        raise TargetError(f"a target holds letters, digits and signs that can be seen, got {word[:40]!r}")
    if "." in word:
        raise TargetError(f"a target holds no dot, which ends a word for some detectors, got {word[:40]!r}")
    if not any(c.isalnum() for c in word):
        raise TargetError(f'a target names a thing ("fire extinguisher"), got {name[:40]!r}')
    return word


@cache
def _synonyms() -> dict[str, str]:
    """By synonym, the word that it stands for."""
    table = json.loads((Path(__file__).parent / "data" / "synonyms.json").read_text(encoding="utf-8"))
    return {other: word for word, others in table.items() for other in others}
