"""How the robot gets to a goal: the terrain, travel times by Fast Marching, and the local planner."""
