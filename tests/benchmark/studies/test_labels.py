"""The study of names counts right, and the default catalogue's names have their labels in every language."""

from __future__ import annotations

import pytest

from surveilnav.benchmark.studies.labels import Named, Score, is_held_out, labels_by_id, names_of, page, score, wrong
from surveilnav.errors import AssetError
from surveilnav.nouns import detect_language
from surveilnav.simulator.furniture.assets import ensure_assets
from surveilnav.simulator.furniture.catalog import DEFAULT_CATALOG, JAR, CatalogModel, read_properties
from surveilnav.simulator.furniture.labels import TARGETS

BED, LAMP = "eTeks#bed", "eTeks#lamp"


def named(id_: str, name: str, library: str = "sweethome3d") -> Named:
    return Named(CatalogModel(id_, "", "", library, "", (1.0, 2.0, 0.6), None), "de", name)


def test_rights_wrongs_and_misses_are_counted() -> None:
    names = [named(BED, "Bett"), named(BED, "Dings"), named(LAMP, "Stuhl"), named(LAMP, "Lampe")]
    assert [labels_by_id().get(id_) for id_ in (BED, LAMP)] == ["bed", None]
    assert score(names, "", TARGETS) == Score(right=1, said=2, there=2)
    assert [str(Score(1, 2, 4)), str(Score(0, 0, 0))] == ["50.0 / 25.0", "- / -"]
    assert wrong(names, "") == ["Dings (): -, should be bed", "Stuhl (): chair, should be -"]


def test_the_page_keeps_held_out_libraries_apart() -> None:
    text = page([named(BED, "Bett"), named(BED, "Dings", "KatorLegaz")])
    read, held_out = text.split("held out\n")
    for part, result in ((read, "100.0 / 100.0"), (held_out, "- / 0.0")):
        assert "| de | 1 |" in part
        assert result in part


def test_escapes_of_a_catalogue_are_read() -> None:
    assert read_properties(rb"name#1=\u5E8A") == {"1": {"name": "床"}}


def test_the_default_catalogue_is_understood_in_every_language() -> None:
    try:
        root = ensure_assets()
    except AssetError as error:
        pytest.skip(f"the furniture isn't fetched: {error}")
    names = list(names_of(root / JAR, DEFAULT_CATALOG))
    assert not any(is_held_out(n) for n in names)
    languages = {n.language for n in names}
    assert len(languages) >= 18
    for code in languages:
        mine = [n for n in names if n.language == code]
        found = score(mine, detect_language(n.name for n in mine), TARGETS)
        assert found.right >= 0.9 * found.said, (code, wrong(mine, code))
        assert found.right >= 0.85 * found.there, (code, wrong(mine, code))
