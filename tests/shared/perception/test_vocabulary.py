"""The names of a closed set of classes, and what is known of them."""

from __future__ import annotations

import msgspec
import pytest

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
    assert COCO.known("Sofa") == "couch"
    assert "sofa" not in COCO
    with pytest.raises(ValueError, match="COCO"):
        COCO.index("sofa")


@pytest.mark.parametrize(
    ("word", "near"), [("table", "dining table"), ("plants", "potted plant"), ("chairs", "chair"), ("zzz", None)]
)
def test_a_word_that_it_does_not_know_is_refused_with_the_nearest(word, near):
    with pytest.raises(TargetError) as raised:
        COCO.known(word)
    assert ("nearest to it" in str(raised.value)) == (near is not None)
    assert near is None or near in str(raised.value)
