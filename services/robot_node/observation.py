"""Turns a body's observation into the message and the payload that are published."""

from __future__ import annotations

from surveilnav import messages
from surveilnav.geometry import Pose
from surveilnav.sensing.packing import encode_rgbd
from surveilnav.services.robot_node.bodies.body import Observation


def encode(
    observation: Observation, robot: str, jpeg_quality: int, *, stamp_ns: int
) -> tuple[messages.Observation, bytes]:
    """The message of an observation, and its pictures, encoded with ``jpeg_quality`` 1-100."""
    state = observation.state
    payload, image, depth = encode_rgbd(
        observation.rgb,
        observation.depth_m,
        depth_range_m=observation.depth_range_m,
        jpeg_quality=jpeg_quality,
    )
    message = messages.Observation(
        stamp_ns=stamp_ns,
        source=f"robot/{robot}",
        view=0,
        seq=state.seq,
        floor=state.floor,
        T_world_camera=Pose.from_matrix(observation.T_world_camera),
        camera=observation.camera,
        mounting_offset_m=observation.mounting_offset_m,
        depth_range_m=observation.depth_range_m,
        image=image,
        depth=depth,
        T_world_base=Pose.from_matrix(state.base_pose()),
        last_action=state.last_action,  # type: ignore[arg-type]
        collided=state.collided,
        path_m=state.path_m,
        scan=observation.scan,
    )
    return message, payload
