"""The joint maps: pure functions of views and of what perception found in them.

joint_map   one view into the maps of its floor, step by step: the only class that the service calls
views/      before the maps: validation, invocation (eq. 1), the order in which views are perceived
maps/       a floor's geometry (cloud, carving, obstacle, explored and frontier grids) and its value map (eq. 2)
objects/    the object map: detections located, associated (eq. 3), fused and confirmed
snapshot    all of it as bytes
config      every number, and the preset ``paper``
warm_up     compiles the inner loops before a robot waits for them
"""

from surveilnav.services.fusion.core.config import FusionConfig, MapConfig, ObjectConfig, ValueConfig
from surveilnav.services.fusion.core.joint_map import IntegrationResult, JointMap, in_order
from surveilnav.services.fusion.core.views.invocation import active_cameras

__all__ = [
    "FusionConfig",
    "IntegrationResult",
    "JointMap",
    "MapConfig",
    "ObjectConfig",
    "ValueConfig",
    "active_cameras",
    "in_order",
]
