"""The table of classes: what words and rooms mean."""

from __future__ import annotations

import pytest

from simulator.furniture.labels import KINDS, TARGETS
from training.detector import classes

NAMES = classes.load()


def test_it_holds_the_goals_the_openings_and_forty_kinds() -> None:
    assert len(NAMES.names) >= 40
    assert {*TARGETS, "door", "window", "stairs"} <= set(NAMES.names)
    assert len(set(NAMES.names)) == len(NAMES.names)


def test_every_kind_of_furniture_has_a_class() -> None:
    assert [kind for kind in sorted(KINDS) if NAMES.number_of(kind) < 0] == []


@pytest.mark.parametrize(
    ("word", "name"), [("sofa", "couch"), ("other table", "table"), ("chest", "chest of drawers"), ("samovar", "")]
)
def test_words_mean_classes(word: str, name: str) -> None:
    number = NAMES.number_of(word)
    assert (NAMES.names[number] if number >= 0 else "") == name


@pytest.mark.parametrize(
    ("name", "kind"),
    [("Flat 0.1 bath", "bathroom"), ("Bedroom #1", "bedroom"), ("Living room", "living room"), ("Room 3", "")],
)
def test_rooms_have_kinds(name: str, kind: str) -> None:
    number = NAMES.room_of(name)
    assert (NAMES.rooms[number] if number >= 0 else "") == kind
