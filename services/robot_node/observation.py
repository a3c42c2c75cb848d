"""A robot's look as the messages and bytes that are put."""

from __future__ import annotations

from dataclasses import dataclass

from surveilnav.bus import clock_ns
from surveilnav.geometry import Pose
from surveilnav.messages import Observation
from surveilnav.sensing.packing import encode_rgbd
from surveilnav.sensing.views import TrueInstances
from surveilnav.services.robot_node import core
from surveilnav.services.robot_node.bodies.body import Look


@dataclass(frozen=True, slots=True, eq=False)
class Encoded:
    """An observation and its payload, as they are put, and put again; ``truth`` from simulators only."""

    observation: Observation
    payload: bytes
    truth: TrueInstances | None


def encode(look: Look, robot: str, jpeg_quality: int) -> Encoded:
    """The observation of one look; ``jpeg_quality`` 1-100."""
    state = look.state
    payload, image, depth = encode_rgbd(
        look.rgb, look.depth_m, depth_range_m=look.depth_range_m, jpeg_quality=jpeg_quality
    )
    observation = Observation(
        stamp_ns=clock_ns(),
        source=f"robot/{robot}",
        view=0,
        seq=state.seq,
        floor=state.floor,
        T_world_camera=Pose.from_matrix(look.T_world_camera),
        camera=look.camera,
        mounting_offset_m=look.mounting_offset_m,
        depth_range_m=look.depth_range_m,
        image=image,
        depth=depth,
        T_world_base=Pose.from_matrix(core.base_pose_of(state)),
        last_action=state.last_action,  # type: ignore[arg-type]
        collided=state.collided,
        path_m=state.path_m,
    )
    return Encoded(observation, payload, look.truth)
