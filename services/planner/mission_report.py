"""What a mission tells others: its status and its plan."""

from __future__ import annotations

from typing import Any

import msgspec

from surveilnav.bus import Node, Publisher, clock_ns
from surveilnav.contract import MISSION_PLAN, MISSION_STATUS
from surveilnav.messages import MissionStatus, Plan, RobotStatus
from surveilnav.services.planner.core import Decision, FloorMaps


class MissionReport:
    """The latest status and plan of one mission. They are published once ``open`` was called.

    Attributes:
        status, plan: the latest ones.
    """

    def __init__(self, node: Node, status: MissionStatus, plan: Plan | None) -> None:
        self._node, self.status, self.plan = node, status, plan
        self._statuses: Publisher | None = None
        self._plans: Publisher | None = None

    def open(self) -> None:
        """Begins to publish, with the present status."""
        self._statuses = self._node.publisher(MISSION_STATUS, mission=self.status.mission)
        self._plans = self._node.publisher(MISSION_PLAN, mission=self.status.mission)
        self.publish_status()

    def close(self) -> None:
        """Ends publishing; the mission has ended."""
        for publisher in (self._statuses, self._plans):
            if publisher is not None:
                publisher.close()

    def update(self, **changes: Any) -> None:
        """Changes fields of the status and stamps it, without publishing it."""
        self.status = msgspec.structs.replace(self.status, stamp_ns=clock_ns(), **changes)

    def publish_status(self, **changes: Any) -> None:
        """Changes fields of the status and publishes it, stamped anew."""
        self.update(**changes)
        self.publish_updated()

    def publish_updated(self) -> None:
        """Publishes the status as the last ``update`` left it, which is what the store has."""
        if self._statuses is not None:
            self._statuses.put(self.status)

    def publish_waiting(self, why: str) -> None:
        """Publishes what the mission waits for, unless the status says so already."""
        if self.status.message != why:
            self.publish_status(phase="waiting", message=why)

    def publish_plan(self) -> None:
        """Publishes the plan."""
        if self._plans is not None and self.plan is not None:
            self._plans.put(self.plan)


def plan_from_decision(
    decision: Decision, mission: MissionStatus, robot: RobotStatus, maps: FloorMaps, *, step: int
) -> Plan:
    """A decision as a message: the action, where it leads, and what was weighed."""
    return Plan(
        stamp_ns=clock_ns(),
        mission=mission.mission,
        robot=mission.robot,
        floor=robot.floor,
        step=step,
        seq=robot.seq,
        action=decision.action or "",
        waypoint=decision.waypoint,
        path_m=[(round(x, 3), round(y, 3)) for x, y in decision.path],
        candidates=list(decision.candidates),
        why=decision.message,
        revision=maps.revision,
        pending_views=maps.pending_views,
    )
