"""ROS 2 without a ROS installation: its messages, services and actions on the wire of rmw_zenoh.

rmw_zenoh carries ROS 2 over Zenoh, which this project speaks anyway: see its design,
https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md. ``names`` has keys, tokens and attachments, ``types`` encodes
messages (by rosbags), ``graph`` knows who is there, and ``session`` publishes, subscribes, and calls services.
"""
