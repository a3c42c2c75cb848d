"""What a router that was frozen for longer than the lease does to the sessions that it still has."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from contextlib import ExitStack

from surveilnav.bus import Answer, BusSettings, Node, clock_ns
from surveilnav.bus.router import free_port
from surveilnav.contract import CAMERA_SUMMARY, ROBOT_STATUS
from surveilnav.geometry import Pose
from surveilnav.messages import CameraSummary, RobotStatus, Truth
from tests.bulk_stream import BULK
from tests.waiting import until, until_heard

N_NODES, FROZEN_S = 24, 6.0
POSE = Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))


def status(name: str) -> RobotStatus:
    return RobotStatus(stamp_ns=clock_ns(), robot=name, floor="0", seq=1, state="ready", T_world_base=POSE)


class Source:
    """A node with several keys of its own, which says its own name on each."""

    def __init__(self, node: Node, name: str) -> None:
        self.name, self.node = name, node
        self.summaries = node.publisher(CAMERA_SUMMARY, floor="0", camera=name)
        self.statuses = node.publisher(ROBOT_STATUS, robot=name)
        self.truths = [node.publisher(BULK, source=name, view=view) for view in range(3)]
        node.serve(ROBOT_STATUS, lambda _: Answer(status(name)), robot=name)

    def publish(self) -> None:
        self.summaries.put(CameraSummary(stamp_ns=clock_ns(), floor="0", camera=self.name, labels={}))
        self.statuses.put(status(self.name))
        for view, truth in enumerate(self.truths):
            truth.put(
                Truth(stamp_ns=clock_ns(), source=self.name, view=view, seq=1, width_px=1, height_px=1, labels={}), b"x"
            )


def test_messages_come_under_their_own_keys_afterwards():
    bus = BusSettings(router=f"tcp/127.0.0.1:{free_port()}", building="test", connect_timeout_s=20)
    router = subprocess.Popen(
        [sys.executable, "-m", "surveilnav.bus.router", "--listen", bus.router], stderr=subprocess.DEVNULL
    )
    names = [f"c{i}" for i in range(N_NODES)]
    wrong: list[str] = []
    with ExitStack() as stack:
        stack.callback(router.wait)
        stack.callback(router.kill)
        reader = stack.enter_context(Node("test", "reader", bus, alive=False))
        sources = [Source(stack.enter_context(Node("camera", name, bus, alive=False)), name) for name in names]
        came: dict[str, int] = {}

        def take(received) -> None:
            message = received.message
            said = getattr(message, "camera", None) or getattr(message, "robot", None) or message.source
            if said not in received.ids.values():
                wrong.append(f"{received.key}: {said}")
            came[received.key] = came.get(received.key, 0) + 1

        for stream in (CAMERA_SUMMARY, ROBOT_STATUS, BULK):
            reader.subscribe(stream, take)

        def all_came() -> bool:
            for source in sources:
                source.publish()
            time.sleep(0.05)
            return len(came) == 5 * N_NODES

        until(all_came, timeout_s=20.0)
        router.send_signal(signal.SIGSTOP)
        end_s = time.monotonic() + FROZEN_S
        while time.monotonic() < end_s:
            for source in sources:
                source.publish()
            time.sleep(0.1)
        router.send_signal(signal.SIGCONT)
        time.sleep(2.5)  # what was queued is out, and every session is back
        came.clear()
        until(all_came, lambda: f"{5 * N_NODES - len(came)} keys are silent", timeout_s=20.0)
        for name in names:
            answered = until_heard(lambda name=name: reader.ask(ROBOT_STATUS, robot=name, timeout_s=2.0))
            assert answered.message.robot == name
        assert not wrong, wrong[:3]
        assert not reader.traffic.rejected(), "messages of another kind came under a key"
