"""Kinds of waypoints, one file each; ``rounds`` has their order."""
