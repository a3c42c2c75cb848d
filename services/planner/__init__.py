"""The planner: missions, waypoint selection and local planning.

service           accepts, cancels, pauses and reports missions
mission_registry  which missions there are, and which robot has which
mission_runner    one mission: waits for maps, has the core decide, stores the decision, commands the robot
mission_report    its status and its plan, as others get them
mission_start     what it begins with
pausing           why it waits for a person or a passage
mission_bus       what a mission asks of fusion and the robot
floor_maps        the maps that a decision is made on: of one moment, and only what changed is transferred
areas             keepout zones, doors and lifts; area_announcer tells others of them
acks              answers to goals, cancels and pauses
store             missions that outlive a restart
core              the decisions, including the stop: ``step`` gives the next action
"""
