"""The joint maps: pure functions of views and what perception says about them."""

from services.fusion.core.config import FusionConfig, MapConfig, ObjectConfig, ValueConfig
from services.fusion.core.invocation import active_cameras
from services.fusion.core.joint_map import Integrated, JointMap, in_order

__all__ = [
    "FusionConfig", "Integrated", "JointMap", "MapConfig", "ObjectConfig", "ValueConfig", "active_cameras", "in_order",
]  # fmt: skip
