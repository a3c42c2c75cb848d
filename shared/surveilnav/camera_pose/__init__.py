"""A camera's pose from points that were clicked in its picture and on a floor plan. Not the calibration of detectors' scores.

floor_plan   a plan's picture with its scale: pixel to metres and back
points       the file of clicks: read and written
solve        the pose, its uncertainty, and which clicks contradict it; by hypotheses and refine
angles       a pose as yaw, pitch and roll
overlay      plan, floor and clicks drawn into the picture
footprint    what the camera sees of the floor, for the plan
"""

from surveilnav.camera_pose.floor_plan import FloorPlan, load_floor_plan
from surveilnav.camera_pose.points import Clicks, load_clicks
from surveilnav.camera_pose.solve import PoseFit, solve_pose

__all__ = ["Clicks", "FloorPlan", "PoseFit", "load_clicks", "load_floor_plan", "solve_pose"]
