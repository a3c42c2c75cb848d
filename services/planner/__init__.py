"""The planner: missions, waypoint selection and local planning."""
