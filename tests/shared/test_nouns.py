"""Names are read by whole words, in the language that knows most of them."""

from __future__ import annotations

import json
from importlib import resources

import pytest
from hypothesis import given
from hypothesis import strategies as st

from surveilnav.nouns import PART, detect_language, split_words, thing_asked_for, thing_named, thing_or_whole, things
from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.world.labels import KINDS, label_of

SIZE = (1.2, 0.8, 0.75)
TABLE = json.loads(resources.files("surveilnav").joinpath("data/words.json").read_text("utf-8"))

NAMES = {
    "bed": "Bett;Doppelbett;Lit;lit superposé;Cama;cama de matrimonio;Letto;Кровать;床;双人床;ベッド;łóżko;Postel;Säng;Sänky;Ágy;"
    "κρεβάτι;yatak;giường;berço;Stapelbed;Легло;single_bed;Bed_2;DoubleBed;BED;sofabed;sofá cama;Schlafsofa;диван-кровать",
    "couch": "Sofá;Canapé;CANAPE;canapé d'angle;Divano;Диван;沙发;ソファー;kanapa;pohovka;Soffa;kanapé;καναπές;kanepe;Ecksofa",
    "chair": "Stuhl;Bürostuhl;Stühle;Chaise;Silla;Sillón;Sedia;Стул;кресло;椅子;krzesło;židle;fåtölj;tuoli;szék;καρέκλα;sandalye;"
    "ghế;cadeira;stoel;Sessel;Fauteuil de bureau;Küchenstuhl;table chair",
    "toilet": "Toilette;WC;inodoro;унитаз;马桶;便器;toaleta;záchod;vaso sanitário;klozet",
    "tv": "Fernseher;Televisor;Télévision;телевизор;电视;テレビ;telewizor;tv_55;TV 16:9;Wandfernseher",
    "potted plant": "Pflanze;Topfpflanze;Plante;растение;植物;観葉植物;roślina;vaso con fiori;Zimmerpflanze",
    "bench": "Bank;Gartenbank;banc;panchina;скамья;长椅;ベンチ",
    "dining table": "Esstisch;Tisch;table à manger;mesa;стол обеденный;餐桌;テーブル;stół;bord;pöytä;asztal",
    "sink": "Waschbecken;lavabo;évier;раковина;洗手盆;洗面台;Washbasin with cabinet",
    "refrigerator": "Kühlschrank;Frigo;nevera;холодильник;冰箱;冷蔵庫;lodówka",
}
NONE = (
    "Nachttisch;table de nuit;table de chevet;床头柜;Bedside table;lampe de chevet;bed_lamp;Bettkasten;BedLeg;Lbl_Bed;Bedroom;"
    "ChairLeg.003;TableTop;Tischlampe;lampe de table;Meuble TV;mueble TV;TV-Schrank;тумба под телевизор;Toilettenbürste;"
    "toilet seat;brosse de toilettes;Blumenbeet;Rollstuhl;fauteuil roulant;silla de ruedas;wheelchair;Fernglas;Stuhlbein;"
    "leg of a bed;tête de lit;coussin de canapé;Spiegel;Schrank;Couchtisch;table basse;журнальный столик;Vegetable;;42;Water"
)


@pytest.mark.parametrize(("name", "label"), [(n, label) for label, names in NAMES.items() for n in names.split(";")])
def test_things_have_their_class_in_every_language(name: str, label: str) -> None:
    assert label_of(name, SIZE) == label


@pytest.mark.parametrize("name", NONE.split(";"))
def test_what_only_sounds_like_a_thing_has_no_class(name: str) -> None:
    assert label_of(name, SIZE) == ""


@given(st.sampled_from(["bed", "chair", "tv", "fern", "sofa", "lit", "cama", "диван"]), st.sampled_from("qxzжщ"))
def test_letters_around_a_word_make_another_word(word: str, letter: str) -> None:
    assert thing_named(word)
    assert thing_named(f"{letter}{word}{letter}") is None


@given(st.text(max_size=300))
def test_any_text_is_a_name(name: str) -> None:
    thing = thing_named(name)
    assert thing in (None, "") or thing in things()
    assert all(word == word.casefold() for word in split_words(name))


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("DoubleBed_2", ("double", "bed")),
        ("TVStand", ("tv", "stand")),
        ("Captain's bed", ("captain", "bed")),
        ("tv_55", ("tv",)),
        ("Fauteuil à l'ancienne", ("fauteuil", "a", "l", "ancienne")),
        ("双人床1", ("双", "人", "床")),
        ("ÉtagèreHaute", ("etagere", "haute")),
        ("ＢＥＤ", ("bed",)),
        ("ÉTAGÈRE HAUTE", ("etagere", "haute")),
        ("Ein SOFÁ", ("ein", "sofa")),
    ],
)
def test_names_are_cut_into_words(name: str, words: tuple[str, ...]) -> None:
    assert split_words(name) == words


def test_the_head_of_a_name_is_meant() -> None:
    assert thing_named("chair table lamp") == "lamp"
    assert thing_named("lampe table chaise") == "lamp"
    assert thing_named("bed with lamp") == "bed"
    assert thing_named("Bett (mit Lampe)") == "bed"


def test_the_language_of_a_home_decides_where_words_are_shared() -> None:
    bulgarian = ["Стол", "Маса", "Легло", "Гардероб", "Хладилник"]
    assert detect_language(bulgarian) == "bg"
    assert (thing_named("Стол"), thing_named("Стол", "bg")) == ("dining table", "chair")
    assert (thing_named("Bank"), thing_named("Bank", "nl")) == ("bench", "couch")
    assert thing_named("Kühlschrank", "nl") == "refrigerator"  # another language knows more of it
    assert detect_language([]) == "en"


@pytest.mark.parametrize(
    ("name", "whole"),
    [
        ("Bed_2", "bed"),
        ("BedLeg", "bed"),
        ("leg of a bed", "bed"),
        ("toilet seat", "toilet"),
        ("Bed sheet", "bed"),
        ("pillow", ""),
    ],
)
def test_parts_name_what_they_are_of(name: str, whole: str) -> None:
    assert thing_or_whole(name) == whole
    assert not label_of(name, SIZE) or whole == label_of(name, SIZE)


@pytest.mark.parametrize(
    ("phrase", "thing"),
    [
        ("Sofa", "couch"),
        ("canapé d'angle", ""),
        ("canapé", "couch"),
        ("床", "bed"),
        ("bed with lamp", "bed"),
        ("bed lamp", "lamp"),
        ("red sofa", ""),
        ("fire extinguisher", ""),
        ("bed sheet", ""),
        ("BedLeg", ""),
        ("wheelchair", ""),
        ("42", ""),
        ("", ""),
        ("Tür", "door"),
        ("Haustür", "door"),
        ("fenêtre", "window"),
        ("fenêtres", "window"),
        ("escalier", "stairs"),
        ("lan can", "railing"),
        ("パソコン", "computer"),
        ("kitchen", ""),
        ("Küche", ""),
        ("kitchen cabinet", "cabinet"),
        ("sofa " * 80, ""),
    ],
)
def test_a_person_s_phrase_names_a_thing_if_every_word_of_it_is_known(phrase: str, thing: str) -> None:
    assert thing_asked_for(phrase) == thing


@pytest.mark.parametrize("code", TABLE["languages"])
def test_what_may_be_asked_for_has_words_in_every_language(code: str) -> None:
    """The first words of the six goals and of a building's parts. A word of two languages goes by the more used one."""
    shared = {
        ("bg", "chair"),
        ("it", "chair"),
        ("nl", "couch"),
        ("pl", "couch"),
        ("bg", "dining table"),
        ("cs", "stairs"),
    }
    row = TABLE["languages"][code]["things"] | TABLE["languages"][code]["also"]
    for thing in (
        "bed",
        "couch",
        "chair",
        "toilet",
        "tv",
        "potted plant",
        "door",
        "window",
        "stairs",
        "railing",
        "computer",
    ):
        phrase = row[thing].split(", ")[0].removeprefix("-")
        assert thing_asked_for(phrase) == thing or (code, thing) in shared, (code, phrase)


def test_furniture_s_names_don_t_mean_what_only_people_ask_for() -> None:
    for name in ("Tür", "window", "computer"):
        assert thing_named(name) in ("", None)
    assert thing_named("kitchen") == "cabinet"


def test_the_table_is_whole() -> None:
    """No word has two meanings in one language; every thing is a class of COCO or a kind of furniture."""
    for code, row in TABLE["languages"].items():
        for listed in (row["things"], row["also"]):
            meanings: dict[tuple[str, ...], str] = {}
            for thing, phrases in listed.items():
                assert thing in ("", PART) or thing in COCO or thing in KINDS or listed is row["also"]
                for phrase in phrases.split(", "):
                    words = split_words(phrase, keeps_accents=row.get("accents") == "kept")
                    assert words, (code, phrase)
                    assert meanings.setdefault(words, thing) == thing, (code, phrase)
                    assert not phrase.startswith("-") or len(words) == 1, (code, phrase)
