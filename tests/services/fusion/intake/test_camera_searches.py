from __future__ import annotations

from surveilnav.services.fusion.intake.camera_searches import CameraSearches


def test_a_search_lasts_as_long_as_its_block() -> None:
    searches = CameraSearches()
    assert not searches.includes("0")
    with searches.open("tv", "0"):
        assert searches.includes("0")
        assert not searches.includes("1")
        with searches.open("bed", None):
            assert searches.includes("1")
            assert sorted(searches.targets()) == ["bed", "tv"]
        assert searches.targets() == ["tv"]
    assert not searches.includes("0")
    assert searches.targets() == []
