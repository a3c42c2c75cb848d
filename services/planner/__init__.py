"""The planner: missions, waypoint selection and local planning.

service     takes and cancels missions
mission     one mission: waits for maps, has the core decide, commands the robot, is on disk before it does
world       what a mission asks of fusion and the robot
store       missions that outlive a restart
core        the decisions, the stop too: ``step`` gives the next action
"""
