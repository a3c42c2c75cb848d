"""A camera of a simulated building, with the building made here."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

from surveilnav.camera_plan import CameraPlan, PlannedCamera
from surveilnav.geometry import Pinhole, Pose, camera_pose
from surveilnav.services.camera_node.sources.simulated import SimulatedSource

VIEWS = [Pose.from_matrix(camera_pose((1.0, 2.0, 1.8), k, math.radians(-30))) for k in range(2)]
CAMERA = PlannedCamera("c1", "0", (1.0, 2.0, 1.8), VIEWS)


class Building:
    plan = CameraPlan("home", "hash", ["0"], 1.7, Pinhole.from_hfov(8, 8, 1.0), [CAMERA])
    scene = SimpleNamespace(truth_labels={5: "bed"})

    def camera_content(self, camera, view):
        return f"{camera.name} {view}"

    def camera_view(self, camera, view):
        assert camera is CAMERA
        full = np.full((8, 8), view)
        return SimpleNamespace(
            rgb=np.stack([full] * 3, 2).astype(np.uint8),
            depth_m=full.astype(np.float32),
            instance_ids=full.astype(np.uint16),
        )


def test_a_place_of_the_plan_and_pictures_of_the_building():
    source = SimulatedSource(Building(), CAMERA)
    place = source.place
    assert (place.name, place.floor, place.position_m, place.mounting_offset_m) == ("c1", "0", (1.0, 2.0, 1.8), 1.7)
    assert list(source.views) == VIEWS
    assert source.intrinsics == Building.plan.intrinsics
    assert source.version(1) == 0
    assert source.content(1) == "c1 1"
    picture = source.latest(1)
    assert picture.version == 0, "a rendered building doesn't change"
    assert (picture.rgb == 1).all()
    assert (picture.depth_m == 1).all()
    assert (picture.truth.ids == 1).all()
    assert picture.truth.labels == {5: "bed"}
    assert (picture.truth.T_world_camera == VIEWS[1].matrix()).all()
