"""What the robot does on the way to a waypoint and there: explore a frontier, approach an object and verify it, take stairs."""
