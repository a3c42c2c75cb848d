"""How the robot gets to a goal: terrain, fast marching, driving."""
