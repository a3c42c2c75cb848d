"""A robot that is taller than obstacles are looked for is named."""

from __future__ import annotations

import pytest

from surveilnav.geometry import Pose
from surveilnav.messages import RobotDescription, RobotStatus
from surveilnav.services.fusion.intake.robot_positions import too_tall


def robot(name: str, height_m: float) -> RobotStatus:
    pose = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    description = RobotDescription(height_m=height_m)
    return RobotStatus(
        stamp_ns=1, robot=name, floor="0", seq=1, state="ready", T_world_base=pose, description=description
    )


@pytest.mark.parametrize(
    ("heights_m", "named"), [([], ""), ([1.0, 1.1], ""), ([1.0, 1.4], "r1"), ([1.5, 1.4], "r0"), ([float("nan")], "")]
)
def test_the_tallest_robot_is_named_if_the_maps_look_too_low(heights_m, named):
    said = too_tall([robot(f"r{i}", height_m) for i, height_m in enumerate(heights_m)], 1.1)
    assert said.startswith(f"robot {named} is 1.") if named else said == ""
    assert not named or "SURVEILNAV_FUSION__MAP__OBSTACLE_MAX_M" in said
