"""A real robot on the wire of ROS 2.

body         the robot as the node uses it
transforms   the tree of frames, and where a frame was at a moment
camera       colour and depth pictures, decoded and paired by their time stamps
place        where the robot is: from its transforms to the building's frame, and whether that can be trusted
waypoint     drives by Nav2's NavigateToPose
velocity     drives by velocities, one discrete action at a time
"""
