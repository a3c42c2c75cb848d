"""On the way to a waypoint and at it: before an object the robot looks, believes and stops; at a frontier it looks past it."""
