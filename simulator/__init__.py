"""A simulated building: what stands in for a real one. Plans and meshes become scenes; scenes are rendered, walked and judged.

``hardware`` has parts of it as processes that look from outside like real devices, such as a robot with ROS 2.
"""
