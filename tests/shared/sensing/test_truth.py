from __future__ import annotations

import msgspec
import numpy as np
import pytest

from surveilnav.errors import WireError
from surveilnav.geometry import camera_pose
from surveilnav.sensing.truth import truth_from_wire, truth_to_wire
from surveilnav.sensing.views import TrueInstances

IDS = np.arange(6, dtype=np.uint16).reshape(2, 3)


def test_instance_ids_survive_the_wire():
    T = camera_pose((1.0, 2.0, 3.0), 0.3, -0.2)
    truth = TrueInstances(IDS, {5: "bed"}, T)
    message, packed = truth_to_wire(truth, source="camera/c1", view=4, seq=9, stamp_ns=7)
    assert (message.source, message.view, message.seq, message.stamp_ns) == ("camera/c1", 4, 9, 7)
    again = truth_from_wire(message, packed)
    assert (again.ids == IDS).all()
    assert again.labels == {5: "bed"}
    assert np.allclose(again.T_world_camera, T)
    nowhere, packed = truth_to_wire(TrueInstances(IDS), source="robot/r1", view=0, seq=1, stamp_ns=7)
    assert truth_from_wire(nowhere, packed).T_world_camera is None


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"width_px": 0}, "0x2 pixels make no sense"),
        ({"height_px": -1}, "pixels make no sense"),
        ({"width_px": 1 << 20, "height_px": 1 << 20}, "pixels make no sense"),
        ({"labels": {0: "bed"}}, "from 1 to 65535"),
        ({"labels": {70_000: "bed"}}, "from 1 to 65535"),
        ({"labels": {1: "b" * 101}}, "at most 100 characters"),
        ({"width_px": 4}, "expected zstd data of 16 bytes"),
    ],
)
def test_what_makes_no_sense_is_refused(changes, why):
    message, packed = truth_to_wire(TrueInstances(IDS), source="robot/r1", view=0, seq=1, stamp_ns=7)
    with pytest.raises(WireError, match=why):
        truth_from_wire(msgspec.structs.replace(message, **changes), packed)
    with pytest.raises(WireError):
        truth_from_wire(message, b"garbage")
