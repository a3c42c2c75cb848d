"""Where a robot's map lies in the building: ``T_building_map``, which takes a place in the robot's map to the building's frame.

planar          the transform: a shift and a turn about the vertical
found_frame     what the methods below return
point_pairs     from places that are known in both frames
tag             from an AprilTag that calibrated cameras see on the robot (imported by itself: it knows files of sightings)
map_match       from the robot's map and the joint map of the same floor; its steps are in coarse_match and map_side
nav2_map        Nav2's map of a floor: from its files, or from the topic ``/map``
drift           whether the robot's frame has moved since
"""

from surveilnav.robot_frame.found_frame import FoundFrame
from surveilnav.robot_frame.map_match import match_maps
from surveilnav.robot_frame.nav2_map import Nav2Map, load_nav2_map
from surveilnav.robot_frame.planar import PlanarTransform
from surveilnav.robot_frame.point_pairs import from_point_pairs

__all__ = ["FoundFrame", "Nav2Map", "PlanarTransform", "from_point_pairs", "load_nav2_map", "match_maps"]
