"""A ROS 2 node by zenoh-ros2-sdk, which isn't ours: publishes texts, prints those it hears, and serves a sum, until it is killed.

``python sdk_peer.py ROUTER DOMAIN``. Definitions are given as texts, else it would fetch them.
"""

from __future__ import annotations

import sys
import time

from zenoh_ros2_sdk import ROS2Publisher, ROS2ServiceServer, ROS2Subscriber

STRING = "string data\n"


def main() -> None:
    router, domain = sys.argv[1:]
    host, port = router.removeprefix("tcp/").split(":")
    place = {"domain_id": int(domain), "router_ip": host, "router_port": int(port)}
    publisher = ROS2Publisher("/chatter", "std_msgs/msg/String", STRING, **place)
    ROS2Subscriber("/said", "std_msgs/msg/String", lambda m: print(f"said {m.data}", flush=True), STRING, **place)
    server = ROS2ServiceServer(
        "/add",
        "example_interfaces/srv/AddTwoInts",
        lambda request: server.response_msg_class(sum=request.a + request.b),
        request_definition="int64 a\nint64 b\n",
        response_definition="int64 sum\n",
        **place,
    )
    print("ready", flush=True)
    while True:
        publisher.publish(data="from the sdk")
        time.sleep(0.05)


if __name__ == "__main__":
    main()
