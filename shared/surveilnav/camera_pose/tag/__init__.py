"""Poses of cameras from an AprilTag that a robot carries past them; nobody has to click.

detection            the tag's corners in a picture; the tag for printing
stops                when the robot stands, and when a camera has seen its tag well enough
sightings            the file of sightings
solve                poses of all cameras, the tag's place on the robot, and which sightings contradict them
start, adjustment    solve's two steps: where they could be, then all together by least squares
model                what the unknowns predict, with derivatives
geometry_of_stops    which stops are missing
"""

from surveilnav.camera_pose.tag.detection import TagDetector, tag_picture
from surveilnav.camera_pose.tag.sightings import Sightings, Stop, Tag, load_sightings, save_sightings
from surveilnav.camera_pose.tag.solve import MIN_STOPS, TagCamera, TagFit, solve_tag

__all__ = [
    "MIN_STOPS",
    "Sightings",
    "Stop",
    "Tag",
    "TagCamera",
    "TagDetector",
    "TagFit",
    "load_sightings",
    "save_sightings",
    "solve_tag",
    "tag_picture",
]
