"""A ROS 2 node by pyzeros, which isn't ours: publishes an odometry, echoes twists, and serves a trigger, until it is killed.

``python pyzeros_peer.py ROUTER DOMAIN``; it prints what it receives.
"""

from __future__ import annotations

import asyncio
import sys

import asyncio_for_robotics as afor
import pyzeros
import zenoh
from ros2_pyterfaces.cydr.all_msgs import Odometry, Twist
from ros2_pyterfaces.cydr.all_srvs import Trigger


@afor.scoped
async def main() -> None:
    heard = pyzeros.Sub(Twist, "cmd_vel")
    odometry = pyzeros.Pub(Odometry, "odom")
    server = pyzeros.Server(Trigger, "dock")
    tasks = afor.Scope.current().task_group

    message = Odometry()
    message.header.frame_id = b"odom"
    message.pose.pose.position.x = 1.5
    message.pose.pose.orientation.w = 1.0
    # It compiles what encodes and decodes a type when that is first used, into the working folder.
    odometry.publish(message)
    Twist.deserialize(Twist().serialize())
    Trigger.Request.deserialize(Trigger.Request().serialize())
    Trigger.Response().serialize()

    async def publish() -> None:
        while True:
            odometry.publish(message)
            await asyncio.sleep(0.05)

    async def echo() -> None:
        async for twist in heard.listen_reliable():
            print(f"twist {float(twist.linear.x):.2f} {float(twist.angular.z):.2f}", flush=True)

    async def serve() -> None:
        async for responder in server.listen_reliable():
            responder.response.success = True
            responder.response.message = b"docked"
            responder.send()

    for work in (publish, echo, serve):
        tasks.create_task(work())
    print("ready", flush=True)
    await asyncio.Future()


if __name__ == "__main__":
    router, domain = sys.argv[1:]
    config = zenoh.Config.from_json5(
        f'{{mode: "client", connect: {{endpoints: ["{router}"]}}, scouting: {{multicast: {{enabled: false}}}}}}'
    )
    with (
        zenoh.open(config) as session,
        pyzeros.auto_context(node="robot", namespace="/r2", zenoh_session=session, domain_id=int(domain)),
    ):
        asyncio.run(main())
