"""The joint maps: pure functions of views and what perception says about them.

invocation            which cameras are active (eq. 1)
view_order            which camera view is looked at first
joint_map             one view into the maps of its floor, step by step
floor_map             a floor's geometry: ``cloud``, ``carving``, ``projection``, ``frontier``
value                 the value map (eq. 2)
objects               the object map: ``sightings`` have a place, ``association`` finds their object (eq. 3)
confirmation          what makes a candidate the target: ``paper_confirmation`` or ours, ``posterior_confirmation``
guard                 views that can't be, refused
config                every number, and the preset ``paper``
warm_up               inner loops compiled before a robot waits for them
"""

from surveilnav.services.fusion.core.config import FusionConfig, MapConfig, ObjectConfig, ValueConfig
from surveilnav.services.fusion.core.joint_map import Integrated, JointMap, in_order
from surveilnav.services.fusion.core.views.invocation import active_cameras

__all__ = [
    "FusionConfig",
    "Integrated",
    "JointMap",
    "MapConfig",
    "ObjectConfig",
    "ValueConfig",
    "active_cameras",
    "in_order",
]
