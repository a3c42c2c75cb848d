"""The robot node: takes commands, has the body carry them out, publishes observations and status."""

from __future__ import annotations

import time

from surveilnav.bus import Answer, Node, bound_request_id, clock_ns
from surveilnav.contract import ROBOT_STATUS
from surveilnav.messages import RobotStatus, WaypointStatus
from surveilnav.robot_state import RobotState
from surveilnav.services.robot_node import core
from surveilnav.services.robot_node.bodies.body import Body, Observation
from surveilnav.services.robot_node.commands import CommandHandler
from surveilnav.services.robot_node.config import RobotSettings
from surveilnav.services.robot_node.halt_switch import HaltSwitch
from surveilnav.services.robot_node.observation import encode
from surveilnav.services.robot_node.publishing import ObservationPublisher
from surveilnav.services.robot_node.verdicts import Judge, StopJudge

_STATUS_PERIOD_S = 1.0


class RobotService:
    """Has the body carry out commands, and publishes what the robot observes: after each action or, if the robot drives to
    waypoints by itself, while it drives."""

    def __init__(self, node: Node, body: Body, settings: RobotSettings, judge: Judge | None = None) -> None:
        self._node, self._body, self._settings = node, body, settings
        self._status_s = self._observed_s = 0.0
        self._observed: RobotState | None = None  # at the last observation
        self._halt_switch = HaltSwitch(settings.store)
        stop_judge = StopJudge(node, settings.id, judge) if judge is not None else None
        self._observations = ObservationPublisher(node, settings.id)
        self._statuses = node.publisher(ROBOT_STATUS, robot=settings.id)
        self._commands = CommandHandler(node, settings.id, body, self._halt_switch, stop_judge)
        self._reported: tuple[str, WaypointStatus | None] = "", None
        node.serve(ROBOT_STATUS, lambda _: Answer(self._status()), robot=settings.id)

    def step(self) -> bool:
        """One turn of the loop: publishes what is due. True if a new observation was published."""
        with bound_request_id(self._commands.request_id):
            return self._publish_due(time.monotonic())

    def _publish_due(self, now_s: float) -> bool:
        with self._commands.acting:
            has_acted, self._commands.has_acted = self._commands.has_acted, False
            self._commands.check_deadline(now_s)
        self._report_if_due(now_s, at_once=has_acted)  # before the pictures, which take their time
        if (observed := self._observe_if_due(now_s, has_acted=has_acted)) is not None:
            self._report_if_due(now_s, at_once=self._body.description.drive == "waypoints")  # its number is new
            quality = self._settings.jpeg_quality
            self._observations.publish(*encode(observed, self._settings.id, quality, stamp_ns=clock_ns()))
            return True
        return False

    def _observe_if_due(self, now_s: float, *, has_acted: bool) -> Observation | None:
        """A new observation; None: none is due, or the body has seen nothing new."""
        if self._body.description.drive == "waypoints":
            period_s = 1.0 / self._settings.observation_hz
            if not core.is_view_due(self._observed, self._body.state, now_s - self._observed_s, period_s):
                return None
            if (observed := self._body.observe()) is not None:
                self._observed, self._observed_s = observed.state, now_s
            return observed
        return self._body.observe() if has_acted else None

    def _report_if_due(self, now_s: float, *, at_once: bool) -> None:
        """Publishes the status if it is time, or if something in it changed that others wait for."""
        facts = self._body.problem, self._body.waypoint
        changed = at_once or self._commands.must_report or _without_progress(facts) != _without_progress(self._reported)
        if not changed and now_s - self._status_s < _STATUS_PERIOD_S:
            return
        self._status_s, self._reported, self._commands.must_report = now_s, facts, False
        self._halt_switch.retry_saving()
        self._statuses.put(self._status())

    def _status(self) -> RobotStatus:
        state = self._body.state  # read once: mission and path must belong together
        halt, commands, problem = self._halt_switch.state, self._commands, self._body.problem
        name = core.reported_state(
            state, halt, deadline_missed=bool(commands.problem), awaiting_command=commands.awaits_command
        )
        return core.status_message(
            state,
            robot=self._settings.id,
            state_name="error" if problem and not halt.halted else name,
            message=halt.refusal("move") or problem or commands.problem,
            stairs=self._body.stairs,
            notes=[*self._body.notes, *self._halt_switch.notes],
            stamp_ns=clock_ns(),
            description=self._body.description,
            waypoint=self._body.waypoint,
            battery=self._body.battery,
        )


def _without_progress(facts: tuple[str, WaypointStatus | None]) -> tuple[str, str, str]:
    """What others wait for of a problem and a waypoint: not how much of the way is left."""
    problem, waypoint = facts
    return problem, waypoint.id if waypoint else "", waypoint.state if waypoint else ""
