"""Drives to waypoints by Nav2: hands each new one over as a goal, follows its feedback, and tells how it ended."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress

from surveilnav.messages import WaypointPose, WaypointStatus
from surveilnav.robot_frame import PlanarTransform
from surveilnav.ros2.navigate_to_pose import Goal, GoalPose, GoalStatus, NavigateToPose
from surveilnav.ros2.session import RosError
from surveilnav.services.robot_node.bodies.ros2.transforms import TransformError

_WATCH_S = 0.05
#: A goal of which Nav2 says nothing for this long is named; after the second time it counts as failed.
_SILENT_S, _GIVEN_UP_S = 3.0, 10.0


class WaypointDrive:
    """Has Nav2 drive to one waypoint at a time. ``drive_to`` returns at once; a thread talks to Nav2.

    Args:
        to_map: a pose (x [m], y [m], yaw [rad]) of the building in the robot's map. Raises TransformError.
    """

    def __init__(
        self, nav2: NavigateToPose, map_frame: str, to_map: Callable[[float, float, float], PlanarTransform]
    ) -> None:
        self._nav2, self._map_frame, self._to_map = nav2, map_frame, to_map
        self._changed = threading.Condition()
        self._wanted: WaypointPose | None = None
        self._status: WaypointStatus | None = None
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="nav2", daemon=True)
        self._thread.start()

    @property
    def status(self) -> WaypointStatus | None:
        """How far it has come with the newest waypoint."""
        return self._status

    def drive_to(self, waypoint: WaypointPose | None) -> None:
        """Begins to drive to a waypoint; the same one again changes nothing. None: the drive ends where the robot is."""
        with self._changed:
            if waypoint is not None and self._status is not None and waypoint.id == self._status.id:
                return
            self._wanted = waypoint
            if waypoint is not None:
                self._status = WaypointStatus(id=waypoint.id, state="driving")
            elif self._status is not None and self._status.state == "driving":
                self._status = WaypointStatus(id=self._status.id, state="cancelled")
            self._changed.notify_all()

    def forget(self) -> None:
        """Ends the drive, and forgets the last waypoint: another mission may use its id."""
        self.drive_to(None)
        with self._changed:
            self._status = None

    def close(self) -> None:
        """Ends the drive and the thread."""
        with self._changed:
            self._wanted, self._closing = None, True
            self._changed.notify_all()
        self._thread.join(timeout=3.0)

    # --- the thread -----------------------------------------------------------------------------------------------

    def _run(self) -> None:
        sent: WaypointPose | None = None
        goal: Goal | None = None
        sent_s = 0.0
        while True:
            with self._changed:
                if self._wanted is sent and not self._closing:
                    self._changed.wait(timeout=_WATCH_S)
                wanted, closing = self._wanted, self._closing
            if wanted is not sent:
                if goal is not None and wanted is None and goal.result is None:
                    with suppress(RosError):
                        self._nav2.cancel(goal)
                goal, sent, sent_s = (self._send(wanted) if wanted is not None else None), wanted, time.monotonic()
            if closing:
                return
            if goal is not None and sent is not None and self._follow(sent, goal, sent_s):
                goal = None

    def _send(self, waypoint: WaypointPose) -> Goal | None:
        """Sends a goal, which replaces the one before. None: it failed, and the status says why."""
        try:
            pose = self._to_map(waypoint.x_m, waypoint.y_m, waypoint.yaw_rad)
            return self._nav2.send(GoalPose(self._map_frame, pose.x_m, pose.y_m, pose.yaw_rad))
        except (RosError, TransformError) as error:
            self._tell(waypoint, "failed", str(error))
            return None

    def _follow(self, waypoint: WaypointPose, goal: Goal, sent_s: float) -> bool:
        """Tells how far the goal has come; True once it has ended."""
        if (result := goal.result) is not None:
            state = {GoalStatus.SUCCEEDED: "reached", GoalStatus.CANCELED: "cancelled"}.get(result.status, "failed")
            self._tell(waypoint, state, result.why)
            return True
        progress = goal.progress
        silent_s = time.monotonic() - (progress.received_s if progress is not None else sent_s)
        if silent_s > _GIVEN_UP_S:
            with suppress(RosError):
                self._nav2.cancel(goal)
            self._tell(waypoint, "failed", f"Nav2 said nothing of the goal for {silent_s:.0f} s: given up")
            return True
        why = f"Nav2 says nothing of the goal since {silent_s:.0f} s" if silent_s > _SILENT_S else ""
        self._tell(waypoint, "driving", why, progress.distance_remaining_m if progress is not None else None)
        return False

    def _tell(self, waypoint: WaypointPose, state: str, why: str = "", remaining_m: float | None = None) -> None:
        with self._changed:
            if self._wanted is waypoint:  # a newer one has a status of its own
                self._status = WaypointStatus(id=waypoint.id, state=state, why=why, remaining_m=remaining_m)  # type: ignore[arg-type]
