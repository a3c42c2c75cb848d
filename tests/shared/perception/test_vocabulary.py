"""The names of a closed set of classes, and what is known of them."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from surveilnav.errors import ConfigError, TargetError
from surveilnav.perception.vocabulary import COCO, DATA, Vocabulary


class Sizes(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    size_m: dict[str, float]


@pytest.fixture
def colours(tmp_path):
    (tmp_path / "priors.json").write_text('{"somebody": {"size_m": {"bed": 2.0}}, "another": {"length_m": {}}}')
    return Vocabulary("COLOURS", ["red", "dark red", "bed"], tmp_path)


def test_a_consumer_reads_its_own_section(colours):
    assert colours.priors("somebody", Sizes) == Sizes({"bed": 2.0})


@pytest.mark.parametrize(
    ("section", "said"),
    [("nobody", "no section 'nobody'; it has another, somebody"), ("another", "isn't what Sizes says")],
)
def test_what_is_wrong_is_named(colours, section, said):
    with pytest.raises(ConfigError, match=said):
        colours.priors(section, Sizes)


def test_classes_have_the_names_of_coco():
    for section, tables in msgspec.json.decode((DATA / "coco" / "priors.json").read_bytes()).items():
        for name, table in tables.items():
            assert set(table) <= set(COCO), f"{section}.{name}"


def test_names_have_numbers_and_any_spelling_finds_them():
    assert (len(COCO), COCO[0], COCO.index("toothbrush"), list(COCO)[62]) == (80, "person", 79, "tv")
    assert COCO.resolve_name("Sofa") == "couch"
    assert "sofa" not in COCO
    with pytest.raises(ValueError, match="COCO"):
        COCO.index("sofa")


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("Sofa", "couch"),
        ("canapé", "couch"),
        ("CANAPE", "couch"),
        ("Fernseher", "tv"),
        ("télé", "tv"),
        ("television", "tv"),
        ("床", "bed"),
        ("fridge", "refrigerator"),
        ("WC", "toilet"),
        ("plants", "potted plant"),
        ("chairs", "chair"),
        ("Esstisch", "dining table"),
        ("a chair", "chair"),
        ("Кровать", "bed"),
        ("hot dog", "hot dog"),
    ],
)
def test_people_s_words_are_understood_in_any_language(word, name):
    assert COCO.resolve_name(word) == name


@pytest.mark.parametrize(
    ("word", "near"),
    [
        ("tabel", "dining table"),
        ("couches", "couch"),
        ("zzz", None),
        ("Fernsehr", "tv"),
        ("Nachttisch", "dining table"),
        ("red sofa", "couch"),
        ("bathroom", "toilet"),
        ("living room", "couch"),
        ("bed sheet", "bed"),
    ],
)
def test_a_word_that_it_does_not_know_is_refused_with_the_nearest(word, near):
    with pytest.raises(TargetError, match="not in this model's vocabulary") as raised:
        COCO.resolve_name(word)
    assert ("nearest are" in str(raised.value)) == (near is not None)
    assert near is None or COCO.nearest(word)[0] == near
    assert near is None or near in str(raised.value)


def test_names_of_its_own_go_before_what_a_word_means_elsewhere():
    own = Vocabulary("OWN", ["table", "dining table", "chest of drawers"], meanings={"chest": "chest of drawers"})
    assert own.resolve_name("table") == "table"
    assert own.resolve_name("Esstisch") == "dining table"
    assert own.resolve_name("Kommode") == own.resolve_name("chest") == "chest of drawers"
    assert own.nearest("Komode") == ["chest of drawers"]


@given(st.text(max_size=300))
@example("-")
@example("")
@example("a b " * 75)
def test_any_text_is_known_or_refused(text):
    assert (COCO.find_name(text) in COCO) == (COCO.find_name(text) != "")
    if not COCO.find_name(text):
        with pytest.raises(TargetError):
            COCO.resolve_name(text)


def test_what_is_akin_in_meaning_comes_first():
    own = Vocabulary("OWN", ["oven", "kitten"], akin={"kitchen": ["oven"]})
    assert own.nearest("kitchen") == ["oven", "kitten"]
    assert own.nearest("kitchen", max_names=1) == ["oven"]
