from __future__ import annotations

import pytest

from surveilnav.perception.vocabulary import COCO
from surveilnav.simulator.furniture.parametric import SIZES_M
from surveilnav.simulator.world.labels import furniture_of, label_of, naming_text, stand_in_of, word_for

SIZE = (1.2, 0.8, 0.75)


@pytest.mark.parametrize(
    ("name", "label"),
    [
        ("Bed", "bed"),
        ("Captain's bed", "bed"),
        ("Bunk bed", "bed"),
        ("Crib", "bed"),
        ("Opened convertible sofa BZ", "bed"),
        ("Bedside table", ""),
        ("Winchester sofa", "couch"),
        ("Sofa 2 seats", "couch"),
        ("Futon couch", "couch"),
        ("Armchair", "chair"),
        ("Office chair", "chair"),
        ("Bar chair", "chair"),
        ("Stool", "chair"),
        ("Footstool", ""),
        ("Wheelchair", ""),
        ("Toilets unit", "toilet"),
        ("Toilet brush", ""),
        ("Toilet paper dispenser", ""),
        ("TV 16:9", "tv"),
        ("Wall flat TV", "tv"),
        ("TV stand", ""),
        ("Television cabinet", ""),
        ("TV remote control", "remote"),
        ("Plant", "potted plant"),
        ("Ficus", "potted plant"),
        ("Tulips", "potted plant"),
        ("Christmas tree", ""),
        ("Fridge & Freezer", "refrigerator"),
        ("Chest freezer", ""),
        ("Cooker", "oven"),
        ("Washbasin", "sink"),
        ("Washbasin with cabinet", "sink"),
        ("Table", "dining table"),
        ("Coffee table", ""),
        ("Pool table", ""),
        ("Laptop", "laptop"),
        ("Vase", "vase"),
        ("Pedestal vase lamp", ""),
        ("Cuckoo clock", "clock"),
        ("Dog house", ""),
        ("Bookcase", ""),
        ("Kitchen cabinet", ""),
        ("Electric radiator", ""),
        ("Carpet", ""),
    ],
)
def test_label_of(name: str, label: str) -> None:
    assert label_of(name, SIZE) == label


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("Bath", "bathtub"),
        ("Bathmat", "rug"),
        ("Bathroom cabinet", "cabinet"),
        ("Shower", "shower"),
        ("Kitchen upper cabinet", "cabinet"),
        ("Dishwasher", "dishwasher"),
        ("Desk", "desk"),
        ("Desk lamp", "lamp"),
        ("Floor uplight", "lamp"),
        ("Television cabinet", "tv stand"),
        ("Coffee table", "other table"),
        ("Bedside table", "bedside table"),
        ("Bookcase", "bookcase"),
        ("Chest of drawers", "chest"),
        ("Thing", ""),
    ],
)
def test_furniture_that_detectors_have_no_class_for_has_a_kind(name: str, kind: str) -> None:
    assert furniture_of(name) == kind
    assert kind not in COCO


@pytest.mark.parametrize(
    ("catalog_id", "name", "told"),
    [
        ("eTeks#bedsideTable", "Nachttisch", "bedsideTable"),
        ("Sheep#coffeeTable", "Стол", "coffeeTable"),
        ("Capretta#estintore", "Extintor", "Extintor"),
        ("", "Bett", "Bett"),
        ("eTeks#bed", "my own", "bed"),
        ("eTeks#texturableBox", "Carpet", "Carpet"),
        ("Ikea-bed#x1", "Sofa", "Sofa"),
        ("plain_sofa", "", "plain_sofa"),
    ],
)
def test_the_catalogue_id_tells_before_the_name_does(catalog_id: str, name: str, told: str) -> None:
    assert naming_text(catalog_id, name) == told


def test_words_for_what_has_no_class() -> None:
    assert word_for("Kleiderschrank", "") == "wardrobe"
    assert word_for("Bücherregal 2", "") == "bookcase"
    assert word_for("Samovar 2", "") == "samovar"
    assert word_for("Plant", "") == ""


def test_size_matters() -> None:
    assert label_of("Table", (1.2, 0.8, 0.4)) == ""
    assert label_of("Ficus", (2.7, 2.8, 5.0)) == ""


def test_stand_ins_are_parametric_pieces() -> None:
    for name, label in (
        ("Fitted bath", ""),
        ("Bookcase", ""),
        ("Floor lamp", ""),
        ("Carpet", ""),
        ("Thing", ""),
        ("", "tv"),
    ):
        assert stand_in_of(name, label) in SIZES_M
    assert stand_in_of("Fitted bath", "") == "bathtub"
