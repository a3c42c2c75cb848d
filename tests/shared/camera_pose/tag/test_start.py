"""The start of the adjustment: of the two poses that a sighting gives, the right one is found."""

from __future__ import annotations

import numpy as np
import pytest

from surveilnav.camera_pose.tag.start import TagPoses, camera_from_tag, first_state
from tests.tag_scenes import T_WORLD_CAMERA, exactly, random_stops, scene_from_poses


@pytest.mark.parametrize("order", [1, -1], ids=["as it comes", "the worse one first"])
def test_a_camera_is_found_by_the_tag_whatever_the_order_of_the_two_poses(
    order: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = TagPoses.from_sightings

    def ordered(seen: object) -> TagPoses:
        poses = right(seen)  # type: ignore[arg-type]
        return TagPoses(poses.R_camera_tag[:, ::order], poses.p_camera[:, ::order])

    monkeypatch.setattr(TagPoses, "from_sightings", ordered)
    state, seen = exactly(scene_from_poses(random_stops(np.random.default_rng(3), 8)))
    assert camera_from_tag(seen, state.T_robot_tag) == pytest.approx(T_WORLD_CAMERA, abs=1e-3)
    found = first_state(seen)
    assert found is not None
    assert found.state.T_world_camera[0] == pytest.approx(T_WORLD_CAMERA, abs=1e-4)
