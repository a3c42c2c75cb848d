"""How the robot gets to a goal: terrain, fast marching, driving, and what it does when it is there."""
