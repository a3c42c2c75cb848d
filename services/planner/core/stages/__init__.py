"""The kinds of waypoints. ``rounds`` has the order in which they are tried."""
