"""What a page or a program has a replay do, and what it tells them of itself."""

from __future__ import annotations

import math
import threading
import time

from surveilnav import contract
from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.cli.replay.clock import ReplayClock
from surveilnav.messages import FASTEST_REPLAY, SLOWEST_REPLAY, ReplayControl, ReplayStatus


class ReplayControls:
    """The clock of a replay, under a lock: bus threads set it, the player asks it.

    ``changed`` is set whenever a person wants something else.
    """

    def __init__(self, node: Node, clock: ReplayClock, mission: str, target: str, began_ns: int) -> None:
        self._node, self._clock = node, clock
        self._mission, self._target, self._began_ns = mission, target, began_ns
        self._lock = threading.Lock()
        self._jump: float | None = None
        self._jumps = 0
        self.changed = threading.Event()
        self._publisher = node.publisher(contract.REPLAY, player=node.id)
        clock.set(time.monotonic())
        node.serve(contract.REPLAY, lambda _: Answer(self.status()), player=node.id)
        node.serve(contract.REPLAY_CONTROL, self._on_control, player=node.id)

    def status(self) -> ReplayStatus:
        with self._lock:
            now_s = time.monotonic()
            return ReplayStatus(
                stamp_ns=clock_ns(),
                player=self._node.id,
                mission=self._mission,
                target=self._target,
                began_ns=self._began_ns,
                at_s=self._clock.at_s(now_s),
                duration_s=self._clock.duration_s,
                speed=self._clock.speed,
                playing=self._clock.playing and not self._clock.ended(now_s),
                jumps=self._jumps,
            )

    def tell(self) -> None:
        self._publisher.put(self.status())

    def begin_anew(self) -> None:
        """Puts the status of one that was taken elsewhere: who hears it forgets what was told before."""
        with self._lock:
            self._jumps += 1
        self.tell()

    def wait_s(self, moment_s: float) -> float:
        """How long until a moment is due."""
        with self._lock:
            return self._clock.wait_s(moment_s, time.monotonic())

    def take_jump(self) -> float | None:
        """Where it should go on from, once; None: where it is."""
        with self._lock:
            jump, self._jump = self._jump, None
            self.changed.clear()
            return jump

    def _on_control(self, request: Request) -> Answer:
        wanted: ReplayControl = request.message
        if wanted.at_s is not None and not math.isfinite(wanted.at_s):
            raise Refused("bad_moment", "at_s is no number")
        if wanted.speed is not None and not SLOWEST_REPLAY <= wanted.speed <= FASTEST_REPLAY:
            raise Refused("bad_speed", f"speed is {SLOWEST_REPLAY:g} to {FASTEST_REPLAY:g}, got {wanted.speed:g}")
        with self._lock:
            now_s = time.monotonic()
            before = self._clock.at_s(now_s)
            self._clock.set(now_s, at_s=wanted.at_s, speed=wanted.speed, playing=wanted.playing)
            after = self._clock.at_s(now_s)
            if wanted.at_s is not None or after < before:
                self._jump = after
            self.changed.set()
        return Answer(self.status())
