"""Listens to one mission and keeps what its report needs: observations, plans, maps, objects, traffic."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from surveilnav.bus import Node
from surveilnav.cli.words import why_perceived
from surveilnav.contract import (
    CAMERA_INFO,
    MAP_REVISION,
    MISSION_PLAN,
    MISSION_STATUS,
    PERCEPTION_LOAD,
    ROBOT_OBSERVATION,
    ROBOT_STATUS,
    TRAFFIC,
)
from surveilnav.messages import (
    FINISHED_STATES,
    CameraInfo,
    MissionStatus,
    Observation,
    Plan,
    Revision,
    TrafficReport,
)


@dataclass
class Recorder:
    """Everything heard about ``mission``. Call ``poll`` often: observations come through a slot of one."""

    node: Node
    mission: str
    robot: str
    observations: dict[int, tuple[Observation, bytes]] = field(default_factory=dict)
    arrived_s: dict[int, float] = field(default_factory=dict)
    plans: dict[int, Plan] = field(default_factory=dict)
    cameras_used: dict[str, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._began_s = time.monotonic()
        self._observation = self.node.latest(ROBOT_OBSERVATION, robot=self.robot)
        self._plan = self.node.table(MISSION_PLAN, mission=self.mission)
        self._status = self.node.table(MISSION_STATUS, mission=self.mission)
        self._revisions = self.node.table(MAP_REVISION)
        self._traffic = self.node.table(TRAFFIC)
        self._loads = self.node.table(PERCEPTION_LOAD)
        self._infos = self.node.table(CAMERA_INFO)
        self._robots = self.node.table(ROBOT_STATUS)

    def poll(self) -> MissionStatus | None:
        """Takes in what has come; the mission's newest status."""
        if received := self._observation.poll():
            header = received.message
            # The picture alone: the depth behind it would be most of the bytes.
            self.observations[header.seq] = (header, received.payload[: header.image.n_bytes])
            self.arrived_s[header.seq] = time.monotonic() - self._began_s
        if rows := self._plan.rows():
            plan = rows[0].message
            self.plans[plan.seq] = plan
        for row in self._revisions.rows():
            for use in row.message.cameras:
                self.cameras_used[use.camera] = max(use.views_processed, self.cameras_used.get(use.camera, 0))
        rows = self._status.rows()
        return rows[0].message if rows else None

    def watch(self, on_change: Callable[[MissionStatus], None], check: Callable[[], None]) -> MissionStatus:
        """Follows the mission to its end. ``check`` is called often and may raise."""
        shown: tuple[object, ...] | None = None
        while True:
            status = self.poll()
            if status is not None:
                now = (status.state, status.phase, status.step, status.message)
                if now != shown:
                    shown = now
                    on_change(status)
                if status.state in FINISHED_STATES:
                    self._settle(wait_for_stop=status.found)
                    return status
            check()
            time.sleep(0.01)

    def _settle(self, *, wait_for_stop: bool) -> None:
        """The last messages come within a second; the view after ``stop`` takes as long as it is rendered."""
        now_s = time.monotonic()
        while time.monotonic() < now_s + (15.0 if wait_for_stop and not self._stopped() else 1.3):
            self.poll()
            time.sleep(0.02)

    def _stopped(self) -> bool:
        return bool(self.observations) and self.observations[max(self.observations)][0].last_action == "stop"

    def traffic(self) -> list[TrafficReport]:
        """What every node has counted now, or as it last said if it doesn't answer."""
        told = {row.key: row.message for row in self._traffic.rows()}
        told |= {row.key: row.message for row in self.node.ask_all(TRAFFIC, timeout_s=1.0)}
        return list(told.values())

    def revisions(self) -> list[Revision]:
        """The newest state of each floor's maps."""
        return [row.message for row in self._revisions.rows()]

    def mapped(self) -> tuple[str, int] | None:
        """The floor whose map holds the newest of the robot's observations, and that one's number; None: none does yet."""
        holding = [(r.robots[self.robot], r.floor) for r in self.revisions() if self.robot in r.robots]
        seq, floor = max(holding, default=(0, ""))
        return (floor, seq) if holding else None

    def camera_infos(self) -> list[CameraInfo]:
        return [row.message for row in self._infos.rows()]

    def perception(self) -> tuple[str, str]:
        """(backend, why it was chosen, and whether its chances are only scores)."""
        rows = self._loads.rows()
        if not rows:
            return "unknown", "no worker said what it runs"
        load = rows[0].message
        return load.backend, why_perceived(load.why, load.calibrated)

    def invoked_cameras(self) -> list[str]:
        """Names of the cameras of which fusion ever processed a view."""
        return sorted(name for name, n in self.cameras_used.items() if n)
