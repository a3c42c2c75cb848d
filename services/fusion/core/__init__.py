"""The joint maps: pure functions of views and of what perception found in them.

joint_map   integrates views into the maps of their floors; the only class that the service calls
views/      validation, camera invocation (eq. 1), and the order in which views are perceived
maps/       a floor's geometry (point cloud, carving, obstacle, exploration and frontier maps) and its value map (eq. 2)
objects/    the object map: detections are located, associated (eq. 3) and fused, and objects are confirmed
snapshot    the joint maps as bytes
config      every number, and the preset ``paper``
warm_up     compiles the inner loops before a robot waits for them
"""

from surveilnav.services.fusion.core.config import FusionConfig, MapConfig, ValueConfig
from surveilnav.services.fusion.core.joint_map import IntegrationResult, JointMap
from surveilnav.services.fusion.core.objects.config import ObjectConfig
from surveilnav.services.fusion.core.views.invocation import active_cameras
from surveilnav.services.fusion.core.views.order import in_order

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
