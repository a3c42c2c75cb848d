"""Keeps a stack's services running: what ends by itself is started again, and everybody may know of it."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import takewhile

from surveilnav.bus import Node, clock_ns
from surveilnav.cli.stack import Stack
from surveilnav.contract import SERVICES
from surveilnav.errors import SurveilNavError
from surveilnav.messages import ServiceList, ServiceState


@dataclass(frozen=True, slots=True)
class RestartPolicy:
    """After ``first_s``, each time in a row after twice as long, at most ``longest_s``. Given up after ``most`` restarts in a
    row; who lives for ``settled_s`` begins a new row, as with Docker's and systemd's counts."""

    first_s: float = 0.5
    longest_s: float = 30.0
    most: int = 8
    settled_s: float = 120.0

    def wait_s(self, lives_s: Sequence[float]) -> float | None:
        """How long to wait after the last of a service's ends; None: give up.

        Args:
            lives_s: how long it lived each time, in order, at least one [s].
        """
        row = sum(1 for _ in takewhile(lambda life_s: life_s < self.settled_s, reversed(lives_s))) or 1
        if row > self.most:
            return None
        return min(self.longest_s, self.first_s * 2.0 ** (row - 1))


@dataclass(slots=True)
class _Life:
    """What happened to one service, by the monotonic clock.

    ``began_s``: its last start. ``lives_s``: how long it lived each time before. ``due_s``: when it is started again; None: it
    runs, or was given up.
    """

    began_s: float
    lives_s: list[float] = field(default_factory=list)
    due_s: float | None = None
    given_up: bool = False
    restarts: int = 0
    restarted_ns: int = 0
    why: str = ""


class Supervisor:
    """Call ``tend`` a few times a second. ``say`` is told what people should read."""

    def __init__(
        self, stack: Stack, node: Node, say: Callable[[str], None], policy: RestartPolicy | None = None, id: str = "up"
    ) -> None:
        self._stack, self._say, self._policy, self._id = stack, say, policy or RestartPolicy(), id
        self._lives = {name: _Life(time.monotonic()) for name in stack.processes}
        self._publisher = node.publisher(SERVICES, supervisor=id)
        self._told_s = 0.0

    def tend(self) -> None:
        """Starts again what has ended, when its time has come; says once a second how everybody is.

        A camera that ends again and again is given up, and the rest goes on.

        Raises:
            SurveilNavError: another service ends again and again; with the end of its log.
        """
        now_s, changed = time.monotonic(), False
        for name, life in self._lives.items():
            if life.given_up:
                continue
            if life.due_s is None and (code := self._stack.processes[name].poll()) is not None:
                self._ended(name, life, code, now_s)
                changed = True
            elif life.due_s is not None and now_s >= life.due_s:
                self._restart(name, life, now_s)
                changed = True
        if changed or now_s - self._told_s >= 1.0:
            self._told_s = now_s
            self._publisher.put(self._services())

    def _ended(self, name: str, life: _Life, code: int, now_s: float) -> None:
        life.lives_s.append(now_s - life.began_s)
        life.why = how_it_ended(code)
        wait_s = self._policy.wait_s(life.lives_s)
        if wait_s is None:
            self._give_up(name, life)
            return
        life.due_s = now_s + wait_s
        self._say(f"{name} ended ({life.why}): it starts again in {wait_s:g} s; its log: {self._stack.log_of(name)}")

    def _give_up(self, name: str, life: _Life) -> None:
        life.given_up = True
        ended = f"{name} ended {self._policy.most + 1} times in a row, last by {life.why}: given up"
        tail = f"The end of its log:\n  {self._stack.log_tail(name)}"
        if not self._stack.can_do_without(name):
            raise SurveilNavError(f"{ended}. {tail}")
        self._say(f"{ended}; the rest goes on without it. {tail}")

    def _restart(self, name: str, life: _Life, now_s: float) -> None:
        life.due_s, life.began_s = None, now_s
        life.restarts, life.restarted_ns = life.restarts + 1, clock_ns()
        self._stack.start(name)
        self._say(f"{name} started again (restart {life.restarts})")

    def _services(self) -> ServiceList:
        states = [
            ServiceState(
                name,
                life.due_s is None and not life.given_up,
                life.restarts,
                life.restarted_ns,
                life.why,
                life.given_up,
            )
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
