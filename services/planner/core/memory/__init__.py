"""What a mission remembers from one step to the next, and the only code that changes it.

mission_state  ``MissionState``: where the robot is, where it is going, how it got there
floor_memory   ``FloorMemory``: places and objects of one floor
blacklist      ``Blacklist``: places that the robot failed to reach
waypoint       ``CurrentWaypoint``: what the robot is heading for, and its progress
floor_goal     which floor the robot wants to reach, and the stairs it took

Questions (``is_…``, ``contains``, ``…_at``) never change anything. What changes the memory is a method whose verb says so.
"""
