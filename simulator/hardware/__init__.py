"""Parts of a simulated building as hardware: processes that look from outside like the real thing.

They speak the protocols of real devices and know nothing of SurveilNav's bus; who connects to them can't tell that they are
simulated. ``ros2_robot``: a robot with ROS 2 and Nav2, on the wire of rmw_zenoh.
"""
