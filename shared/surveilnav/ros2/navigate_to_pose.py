"""A client of Nav2's action ``NavigateToPose``: sends a goal, follows its feedback, cancels it, and waits for its result.

Source: https://design.ros2.org/articles/actions.html. Nav2's types differ by distribution; only fields that all have are used.
"""

from __future__ import annotations

import enum
import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from surveilnav.errors import WireError
from surveilnav.ros2 import types
from surveilnav.ros2.names import Qos
from surveilnav.ros2.session import RosError, RosMessage, RosSession

_CANCEL_TIMEOUT_S = 2.0
_CDR_HEADER_BYTES = 4
#: In a request to cancel it stands for all goals (action_msgs/srv/CancelGoal).
_ALL_GOALS = bytes(16)
_CANCEL_REJECTED = 1
#: Results that a server keeps for those who ask late.
_KEPT_RESULTS = 100
_RESULT_TIMEOUT_S = 3600.0  # a goal may take long; who sends it stops waiting by cancelling it


class GoalStatus(enum.IntEnum):
    """action_msgs/msg/GoalStatus."""

    UNKNOWN = 0
    ACCEPTED = 1
    EXECUTING = 2
    CANCELING = 3
    SUCCEEDED = 4
    CANCELED = 5
    ABORTED = 6


@dataclass(frozen=True, slots=True)
class GoalPose:
    """Where the robot is to go: position [m] and direction [rad] in a frame of the robot's, such as ``map``."""

    frame: str
    x_m: float
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class Progress:
    """Nav2's feedback on a goal. ``distance_remaining_m``: along its path; ``recoveries``: how often it had to free itself."""

    x_m: float
    y_m: float
    distance_remaining_m: float
    recoveries: int
    received_s: float


@dataclass(frozen=True, slots=True)
class GoalResult:
    """How a goal ended. ``why``: for people; empty if it succeeded."""

    status: GoalStatus
    why: str = ""


class Goal:
    """A goal that Nav2 has accepted. ``result``: None while it goes on; ``progress``: the newest feedback, if any."""

    def __init__(self, id: bytes, pose: GoalPose) -> None:
        self.id, self.pose = id, pose
        self.progress: Progress | None = None
        self.result: GoalResult | None = None
        self._ended = threading.Event()

    def wait(self, timeout_s: float) -> GoalResult | None:
        """The result, once it is there; None if it isn't in time."""
        self._ended.wait(timeout_s)
        return self.result

    def end(self, result: GoalResult) -> None:
        self.result = result
        self._ended.set()


class NavigateToPose:
    """One action server's client. ``action``: the action's name, such as ``navigate_to_pose``, in the session's namespace."""

    def __init__(self, session: RosSession, action: str = "navigate_to_pose") -> None:
        self._session, self._action = session, action
        self._goals: dict[bytes, Goal] = {}
        feedback = f"{action}/_action/feedback"
        session.subscribe(feedback, "nav2_msgs/action/NavigateToPose_FeedbackMessage", self._on_feedback)

    def send(self, pose: GoalPose, timeout_s: float = 5.0) -> Goal:
        """Sends a goal, and returns it once Nav2 has accepted it.

        Raises:
            RosError: no such action is there, it doesn't answer, or it rejects the goal.
        """
        goal = Goal(secrets.token_bytes(16), pose)
        stamped = _stamped(pose)
        wanted = types.make("nav2_msgs/action/NavigateToPose_Goal", pose=stamped, behavior_tree="")
        request = types.make("nav2_msgs/action/NavigateToPose_SendGoal_Request", goal_id=_uuid(goal.id), goal=wanted)
        self._goals[goal.id] = goal  # feedback may come before the answer does
        try:
            response = self._call("send_goal", request, "nav2_msgs/action/NavigateToPose_SendGoal_Response", timeout_s)
            if not response.accepted:
                raise RosError(
                    f"{self._action} rejects the goal ({pose.x_m:.2f}, {pose.y_m:.2f}) in frame {pose.frame!r}"
                )
        except Exception:
            del self._goals[goal.id]
            raise
        threading.Thread(target=self._await_result, args=(goal,), name="goal-result", daemon=True).start()
        return goal

    def cancel(self, goal: Goal, timeout_s: float = _CANCEL_TIMEOUT_S) -> bool:
        """Has Nav2 cancel a goal; returns whether it will. RosError: it doesn't answer."""
        time_ = types.make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        info = types.make("action_msgs/msg/GoalInfo", goal_id=_uuid(goal.id), stamp=time_)
        request = types.make("action_msgs/srv/CancelGoal_Request", goal_info=info)
        response = self._call("cancel_goal", request, "action_msgs/srv/CancelGoal_Response", timeout_s)
        return goal.id in {bytes(info.goal_id.uuid) for info in response.goals_canceling}

    def _await_result(self, goal: Goal) -> None:
        request = types.make("nav2_msgs/action/NavigateToPose_GetResult_Request", goal_id=_uuid(goal.id))
        try:
            service = f"{self._action}/_action/get_result"
            response = self._session.call_encoded(service, types.encode(request), _RESULT_TIMEOUT_S)
            # The status is the byte after CDR's header; what follows differs by distribution.
            status = response[_CDR_HEADER_BYTES] if len(response) > _CDR_HEADER_BYTES else 0
            known = GoalStatus(status) if status in set(GoalStatus) else GoalStatus.UNKNOWN
            text = _error_text(response)
            why = f"{self._action} ended the goal: {known.name.lower()}" + (f", {text}" if text else "")
            why = "" if known is GoalStatus.SUCCEEDED else why
            goal.end(GoalResult(known, why))
        except RosError as error:
            goal.end(GoalResult(GoalStatus.UNKNOWN, str(error)))
        finally:
            self._goals.pop(goal.id, None)

    def _call(self, service: str, request: Any, response_type: str, timeout_s: float) -> Any:
        return self._session.call(f"{self._action}/_action/{service}", request, response_type, timeout_s)

    def _on_feedback(self, message: RosMessage) -> None:
        goal = self._goals.get(bytes(message.data.goal_id.uuid))
        if goal is None:
            return  # another client's
        told = message.data.feedback
        position = told.current_pose.pose.position
        goal.progress = Progress(
            position.x, position.y, told.distance_remaining, told.number_of_recoveries, time.monotonic()
        )


class NavigateToPoseServer:
    """The other end, for tests and simulated robots: ``accept`` says whether a goal is taken, and then has it driven.

    ``cancel`` is called with the id of a goal that is to end, and says whether it will. ``end`` tells the result. Like
    rclcpp's servers it publishes the states of its goals on ``_action/status``.
    """

    def __init__(
        self,
        session: RosSession,
        accept: Callable[[bytes, GoalPose], bool],
        cancel: Callable[[bytes], bool],
        *,
        action: str = "navigate_to_pose",
    ) -> None:
        self._accept, self._cancel = accept, cancel
        self._results: dict[bytes, GoalResult] = {}
        self._states: dict[bytes, GoalStatus] = {}
        self._ended = threading.Condition()
        package, name = "nav2_msgs/action", "NavigateToPose"
        services = (
            ("send_goal", f"{package}/{name}_SendGoal", f"{package}/{name}_SendGoal_Request", self._on_goal),
            ("get_result", f"{package}/{name}_GetResult", f"{package}/{name}_GetResult_Request", self._on_result),
            ("cancel_goal", "action_msgs/srv/CancelGoal", "action_msgs/srv/CancelGoal_Request", self._on_cancel),
        )
        for service, type_name, request_type, handler in services:
            # ROS's own hash of a service isn't known here; clients take it from the token
            hash_of_request = types.type_hash(request_type)
            waits = handler == self._on_result
            session.serve(f"{action}/_action/{service}", type_name, request_type, handler, hash_of_request, waits=waits)
        self._feedback = session.publisher(
            f"{action}/_action/feedback", "nav2_msgs/action/NavigateToPose_FeedbackMessage"
        )
        kept = Qos(transient_local=True, depth=1)
        self._status = session.publisher(f"{action}/_action/status", "action_msgs/msg/GoalStatusArray", kept)

    def tell_progress(
        self, id: bytes, pose: GoalPose, distance_remaining_m: float, recoveries: int = 0, elapsed_s: float = 0.0
    ) -> None:
        """Publishes feedback on a goal: where the robot is, and how long it has been driving."""
        duration = types.make("builtin_interfaces/msg/Duration", sec=0, nanosec=0)
        elapsed_ns = round(elapsed_s * 1e9)
        elapsed = types.make("builtin_interfaces/msg/Duration", sec=elapsed_ns // 10**9, nanosec=elapsed_ns % 10**9)
        feedback = types.make(
            "nav2_msgs/action/NavigateToPose_Feedback",
            current_pose=_stamped(pose),
            navigation_time=elapsed,
            estimated_time_remaining=duration,
            number_of_recoveries=recoveries,
            distance_remaining=distance_remaining_m,
        )
        self._feedback.put(
            types.make("nav2_msgs/action/NavigateToPose_FeedbackMessage", goal_id=_uuid(id), feedback=feedback)
        )

    def end(self, id: bytes, status: GoalStatus, why: str = "") -> None:
        """Tells everybody who waits how a goal ended. ``why``: as Nav2's ``error_msg``."""
        with self._ended:
            self._results[id] = GoalResult(status, why)
            for old in list(self._results)[:-_KEPT_RESULTS]:
                del self._results[old]
                self._states.pop(old, None)
            self._ended.notify_all()
        self._publish_state(id, status)

    def _on_goal(self, request: Any) -> Any:
        pose = _pose_in(request.goal.pose)
        id = bytes(request.goal_id.uuid)
        accepted = self._accept(id, pose)
        if accepted:
            self._publish_state(id, GoalStatus.EXECUTING)
        stamp = types.make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        return types.make("nav2_msgs/action/NavigateToPose_SendGoal_Response", accepted=accepted, stamp=stamp)

    def _on_result(self, request: Any) -> Any:
        id = bytes(request.goal_id.uuid)
        with self._ended:
            self._ended.wait_for(lambda: id in self._results)
            result = self._results[id]
        return types.make(
            "nav2_msgs/action/NavigateToPose_GetResult_Response",
            status=int(result.status),
            error_code=0,
            error_msg=result.why,
        )

    def _on_cancel(self, request: Any) -> Any:
        info = request.goal_info
        id, now = bytes(info.goal_id.uuid), info.stamp
        with self._ended:
            active = [goal for goal in self._states if goal not in self._results]
        wanted = active if id == _ALL_GOALS else [id]
        cancelling = [
            types.make("action_msgs/msg/GoalInfo", goal_id=_uuid(goal), stamp=now)
            for goal in wanted
            if self._cancel(goal)
        ]
        return_code = 0 if cancelling else _CANCEL_REJECTED
        return types.make("action_msgs/srv/CancelGoal_Response", return_code=return_code, goals_canceling=cancelling)

    def _publish_state(self, id: bytes, status: GoalStatus) -> None:
        stamp = types.make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
        with self._ended:
            ended = self._results.get(id)
            self._states[id] = ended.status if ended is not None else status
            states = list(self._states.items())
        listed = [
            types.make(
                "action_msgs/msg/GoalStatus",
                goal_info=types.make("action_msgs/msg/GoalInfo", goal_id=_uuid(goal), stamp=stamp),
                status=int(state),
            )
            for goal, state in states
        ]
        self._status.put(types.make("action_msgs/msg/GoalStatusArray", status_list=listed))


def _error_text(response: bytes) -> str:
    """Why a goal failed, where Nav2's result says so (since Kilted); empty where it doesn't."""
    try:
        return str(types.decode(response, "nav2_msgs/action/NavigateToPose_GetResult_Response").error_msg)
    except WireError:
        return ""


def _uuid(id: bytes) -> Any:
    return types.make("unique_identifier_msgs/msg/UUID", uuid=np.frombuffer(id, np.uint8))


def _stamped(pose: GoalPose) -> Any:
    """geometry_msgs/PoseStamped, at no time in particular: Nav2 then uses the newest transform."""
    stamp = types.make("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    half = pose.yaw_rad / 2
    return types.make(
        "geometry_msgs/msg/PoseStamped",
        header=types.make("std_msgs/msg/Header", stamp=stamp, frame_id=pose.frame),
        pose=types.make(
            "geometry_msgs/msg/Pose",
            position=types.make("geometry_msgs/msg/Point", x=pose.x_m, y=pose.y_m, z=0.0),
            orientation=types.make(
                "geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half))
            ),
        ),
    )


def _pose_in(stamped: Any) -> GoalPose:
    p, q = stamped.pose.position, stamped.pose.orientation
    return GoalPose(stamped.header.frame_id, p.x, p.y, float(2 * np.arctan2(q.z, q.w)))
