"""The kinds of waypoints, one stage in a file each. ``rounds`` has the order in which they are tried."""
