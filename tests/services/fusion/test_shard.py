"""Shards of a building: which settings are valid, and which service answers for which floor."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.shard import WHOLE_BUILDING

TWO = {"low": ["0", "1"], "high": ["2"]}


def test_a_shard_has_its_floors_and_a_store_of_its_own():
    settings = FusionSettings(shards=TWO, store="/state/fusion.sqlite")
    low = settings.shard("low")
    assert (low.name, low.includes("1"), low.includes("2")) == ("low", True, False)
    assert settings.for_shard("high").store == "/state/fusion-high.sqlite"
    assert FusionSettings(shards=TWO).for_shard("high").store == ""
    assert WHOLE_BUILDING.includes("anything")


@pytest.mark.parametrize(
    ("shards", "told"),
    [
        ({"low": ["0"], "high": ["0"]}, "floor '0' is listed twice"),
        ({"low": []}, "shard 'low' has no floors"),
        ({"lo/w": ["0"]}, "got 'lo/w'"),
        ({"low": ["a floor"]}, "got 'a floor'"),
    ],
)
def test_shards_that_cannot_be_are_refused(shards, told):
    with pytest.raises(ValidationError, match=told):
        FusionSettings(shards=shards)
