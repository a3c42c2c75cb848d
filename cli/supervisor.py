"""Keeps a stack's services running: what ends by itself is started again, and everybody may know of it."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from cli.restarts import RestartPolicy
from cli.stack import Stack
from surveilnav.bus import Node, clock_ns
from surveilnav.contract import SERVICES
from surveilnav.errors import SurveilNavError
from surveilnav.messages import ServiceList, ServiceState


@dataclass(slots=True)
class _Life:
    """What happened to one service. ``due_s``: when it is started again (monotonic clock); None: it runs."""

    ends_s: list[float] = field(default_factory=list)
    due_s: float | None = None
    restarts: int = 0
    restarted_ns: int = 0
    why: str = ""


class Supervisor:
    """Call ``tend`` a few times a second. ``say`` is told what people should read."""

    def __init__(
        self, stack: Stack, node: Node, say: Callable[[str], None], policy: RestartPolicy | None = None, id: str = "up"
    ) -> None:
        self._stack, self._say, self._policy, self._id = stack, say, policy or RestartPolicy(), id
        self._lives = {name: _Life() for name in stack.processes}
        self._publisher = node.publisher(SERVICES, supervisor=id)
        self._told_s = 0.0

    def tend(self) -> None:
        """Starts again what has ended, when its time has come; says once a second how everybody is.

        Raises:
            SurveilNavError: a service ends again and again; with the end of its log.
        """
        now_s, changed = time.monotonic(), False
        for name, life in self._lives.items():
            if life.due_s is None and (code := self._stack.processes[name].poll()) is not None:
                self._ended(name, life, code, now_s)
                changed = True
            if life.due_s is not None and now_s >= life.due_s:
                self._restart(name, life)
                changed = True
        if changed or now_s - self._told_s >= 1.0:
            self._told_s = now_s
            self._publisher.put(self._services())

    def _ended(self, name: str, life: _Life, code: int, now_s: float) -> None:
        life.ends_s.append(now_s)
        life.why = how_it_ended(code)
        wait_s = self._policy.wait_s(life.ends_s)
        if wait_s is None:
            raise SurveilNavError(
                f"{name} ended more than {self._policy.most} times within {self._policy.within_s:g} s, last by {life.why}: given "
                f"up. The end of its log:\n  {self._stack.log_tail(name)}"
            )
        life.due_s = now_s + wait_s
        self._say(f"{name} ended ({life.why}): it starts again in {wait_s:g} s; its log: {self._stack.log_of(name)}")

    def _restart(self, name: str, life: _Life) -> None:
        life.due_s = None
        life.restarts, life.restarted_ns = life.restarts + 1, clock_ns()
        self._stack.start(name)
        self._say(f"{name} started again (restart {life.restarts})")

    def _services(self) -> ServiceList:
        states = [
            ServiceState(name, life.due_s is None, life.restarts, life.restarted_ns, life.why)
            for name, life in self._lives.items()
        ]
        return ServiceList(stamp_ns=clock_ns(), supervisor=self._id, services=states)


def how_it_ended(code: int) -> str:
    """An exit status of ``subprocess`` for people: below 0 it is the signal that killed the process."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"signal {-code}"
