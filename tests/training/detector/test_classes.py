"""The table of classes: what words and rooms mean."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from surveilnav.nouns import phrases_by_thing
from surveilnav.perception.vocabulary import Vocabulary
from surveilnav.simulator.world.labels import KINDS, TARGETS
from training.detector import classes

NAMES = classes.load()


def test_it_holds_the_goals_the_openings_and_forty_kinds() -> None:
    assert len(NAMES.names) >= 40
    assert {*TARGETS, "door", "window", "stairs"} <= set(NAMES.names)
    assert len(set(NAMES.names)) == len(NAMES.names)


def test_every_kind_of_furniture_has_a_class() -> None:
    assert [kind for kind in sorted(KINDS) if NAMES.number_of(kind) < 0] == []


def test_every_word_of_the_table_means_its_class_and_no_other() -> None:
    table = json.loads((Path(classes.__file__).parent / "data" / "classes.json").read_text(encoding="utf-8"))
    assert [
        w for name, words in table["classes"].items() for w in words if NAMES.names[NAMES.number_of(w)] != name
    ] == []
    assert [w for kind, words in table["rooms"].items() for w in words if NAMES.rooms[NAMES.room_of(w)] != kind] == []


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


def test_people_have_words_for_every_class_and_room_names_are_none() -> None:
    known = classes.load()
    vocabulary, phrases = Vocabulary("compact", known.names, meanings=known.meanings), phrases_by_thing()
    things: dict[str, list[str]] = {name: [name] for name in known.names}
    for word, name in known.meanings.items():
        things[name].append(word)
    for name in known.names:
        said = [phrase for thing in things[name] for phrase in phrases.get(thing, ())]
        wrong = [phrase for phrase in said if vocabulary.find_name(phrase) != name]  # words of two languages
        assert said, name
        assert len(wrong) <= max(1, 0.15 * len(said)), (name, wrong)
    assert [room for room in known.rooms if vocabulary.find_name(room) not in ("", room)] == []
