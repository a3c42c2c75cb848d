"""Definitions of actions and services that rosbags doesn't bring, in ROS's own notation, for ``types``.

The parts of an action are messages of their own: goal, result and feedback, and around them the requests and responses of the
services ``_action/send_goal``, ``_action/get_result`` and ``_action/cancel_goal``.
Source: https://github.com/ros-navigation/navigation2, nav2_msgs/action/NavigateToPose.action (Jazzy), and
https://design.ros2.org/articles/actions.html.
"""

from __future__ import annotations

DEFINITIONS: dict[str, str] = {
    "nav2_msgs/msg/NavigateToPose_Goal": "geometry_msgs/PoseStamped pose\nstring behavior_tree",
    "nav2_msgs/msg/NavigateToPose_Feedback": "\n".join(
        [
            "geometry_msgs/PoseStamped current_pose",
            "builtin_interfaces/Duration navigation_time",
            "builtin_interfaces/Duration estimated_time_remaining",
            "int16 number_of_recoveries",
            "float32 distance_remaining",
        ]
    ),
    "nav2_msgs/msg/NavigateToPose_SendGoal_Request": "\n".join(
        ["unique_identifier_msgs/UUID goal_id", "nav2_msgs/NavigateToPose_Goal goal"]
    ),
    "nav2_msgs/msg/NavigateToPose_SendGoal_Response": "bool accepted\nbuiltin_interfaces/Time stamp",
    "nav2_msgs/msg/NavigateToPose_GetResult_Request": "unique_identifier_msgs/UUID goal_id",
    # Results differ: none in Humble, a code in Jazzy, a code and a text later. The status comes first in all of them.
    "nav2_msgs/msg/NavigateToPose_GetResult_Response": "int8 status\nuint16 error_code\nstring error_msg",
    "nav2_msgs/msg/NavigateToPose_FeedbackMessage": "\n".join(
        ["unique_identifier_msgs/UUID goal_id", "nav2_msgs/NavigateToPose_Feedback feedback"]
    ),
    "action_msgs/msg/CancelGoal_Request": "action_msgs/GoalInfo goal_info",
    "action_msgs/msg/CancelGoal_Response": "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
}
