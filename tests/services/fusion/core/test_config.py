"""Settings."""

from __future__ import annotations

import pytest

from surveilnav.errors import ConfigError
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import FusionConfig


def test_one_number_from_the_environment_on_top_of_a_preset(monkeypatch):
    monkeypatch.setenv("SURVEILNAV_FUSION__PRESET", "paper")
    monkeypatch.setenv("SURVEILNAV_FUSION__OBJECTS__ASSOCIATION__TAU", "1.2")
    monkeypatch.setenv("SURVEILNAV_FUSION__SURVEILLANCE", "false")
    settings = FusionSettings()
    assert settings.surveillance is False
    paper = FusionConfig.preset("paper")
    assert settings.core() == paper.changed({"objects": {"association": {"tau": 1.2}}}) != paper
    association = paper.objects.association
    assert settings.core().objects.association == association.model_copy(update={"tau": 1.2})
    assert (paper.value.fusion, association.geometry, association.tau) == ("average", "box_iou", 1.35)
    assert (paper.map.voxel_m, paper.map.resolution_m, paper.map.tau_z_m) == (0.025, 0.05, 0.4)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("OBJECTS__ASSOCIATION__TAUU", "1", "OBJECTS__ASSOCIATION__TAUU"),
        ("VALUE__FUSION", "best", "'average', 'confidence' or 'latest'"),
    ],
)
def test_a_wrong_setting_is_named(monkeypatch, name, value, said):
    monkeypatch.setenv(f"SURVEILNAV_FUSION__{name}", value)
    with pytest.raises(ConfigError, match=said):
        FusionSettings().core()
