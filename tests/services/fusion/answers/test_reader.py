"""Value layers that are built while the maps change."""

from __future__ import annotations

import numpy as np

from surveilnav.services.fusion.answers.reader import MapReader
from surveilnav.services.fusion.core.maps.value import PendingLayer
from surveilnav.services.fusion.intake.robot_positions import RobotPositions
from tests.fusion_run import Run


def test_a_layer_that_was_built_of_maps_that_are_no_more_is_not_kept(tools, monkeypatch):
    """While it is built, a source is taken out of the maps: the layer would hold its views."""
    both, without = Run("", tools, store=""), Run("", tools, store="")
    for run in (both, without):
        run.log.integrate([run.view(1)])
    both.log.integrate([both.view(2, "camera/c", x=4.0)])
    text = np.arange(8, dtype=np.float32), ""
    expected = without.maps.joint.layer("0", "value", *text)[1]
    build = PendingLayer.build

    def swap(self):
        both.maps.replace_by(without.maps)
        return build(self)

    monkeypatch.setattr(PendingLayer, "build", swap)
    MapReader(both.maps, None, RobotPositions()).build_value("0", text)
    assert np.array_equal(both.maps.joint.layer("0", "value", *text)[1], expected, equal_nan=True)
