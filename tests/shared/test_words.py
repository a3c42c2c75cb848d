"""What counts as a word for a thing."""

from __future__ import annotations

import pytest

from surveilnav.errors import TargetError
from surveilnav.words import MAX_WORD_CHARS, validate_word


@pytest.mark.parametrize(
    ("said", "word"),
    [("Fire  Extinguisher", "fire extinguisher"), ("Sofa", "couch"), ("книга", "книга"), ("coat_rack", "coat rack")],
)
def test_a_word_has_one_spelling(said: str, word: str) -> None:
    assert validate_word(said) == word


@pytest.mark.parametrize(
    "said", ["", "  ", "?!", "tv\x00", "a\u202eb", "st. bernard", "tv. bed", "x" * (MAX_WORD_CHARS + 1), "x" * 10_000]
)
def test_what_no_detector_can_look_for(said: str) -> None:
    with pytest.raises(TargetError, match="target"):
        validate_word(said)
