"""Every kind of fault, and how one is played: in the midst of a search, until the search has ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Literal

from surveilnav.messages import FINISHED_STATES
from tests.e2e.kills import SERVICES, Up
from tests.faults.system import NETWORK, Faulty, faketime

Phase = Literal["exploring", "approaching"]
FROZEN_S = CUT_S = 10.0
#: A search must end so soon after the fault began.
END_S = 180.0
#: The gateway is asked so often how the mission is.
_LOOK_S = 0.05
_TARGETS = ("tv", "bed")
#: The phases of a mission in which a fault happens: it explores as soon as the robot looks around.
_PHASES: dict[Phase, tuple[str, ...]] = {"exploring": ("scanning", "exploring"), "approaching": ("approaching",)}
#: The services that are frozen in `make test-faults`, too.
_FROZEN = ("perception", "fusion", "planner", "robot")


@dataclass(frozen=True)
class Fault:
    """A kind of fault.

    Attributes:
        name: in reports.
        phase: of the mission, at which it happens.
        strike: makes it happen, and returns how long after its end the system was back [s].
        may_end: services that end because of it.
        may_fail: with this error the search may fail; "": it must be found.
        apart: the service that is in a network of its own from before the search until after it.
        needs: what it takes: "network", "small disk" or "faketime"; "" nothing.
        rare: whether it is only played by `make soak`, because another one is much like it.
    """

    name: str
    phase: Phase
    strike: Callable[[Faulty], float]
    may_end: tuple[str, ...] = ()
    needs: str = ""
    may_fail: str = ""
    apart: str = ""
    rare: bool = False


@dataclass(frozen=True)
class Played:
    """What became of a mission during which a fault happened.

    Attributes:
        state, error: of the mission; "" for no error.
        recovery_s: until the service that was struck was back.
        mission_s: how long the mission took.
        wrong: what should not have been.
        standstill_s: the longest time for which the mission made no step, from the fault on.
    """

    fault: str
    state: str
    found: bool
    error: str
    recovery_s: float
    mission_s: float
    wrong: tuple[str, ...] = ()
    standstill_s: float = 0.0


def _kill(name: str, phase: Phase) -> Fault:
    rare = phase == "approaching" and name not in ("robot", "fusion", "planner")
    return Fault(f"kill -9 {_kind(name)}, {phase}", phase, lambda faulty: faulty.system.kill(name), (name,), rare=rare)


def _freeze(name: str) -> Fault:
    return Fault(
        f"{_kind(name)} frozen for 10 s",
        "exploring",
        lambda faulty: faulty.freeze(name, FROZEN_S),
        rare=name not in _FROZEN,
    )


def _cut(name: str) -> Fault:
    def strike(faulty: Faulty) -> float:
        faulty.cut(CUT_S)
        return faulty.time_until_heard(name)

    rare = name not in ("robot", "fusion")
    return Fault(f"network of {_kind(name)} cut for 10 s", "exploring", strike, needs="network", apart=name, rare=rare)


def _clock(name: str, offset: str) -> Fault:
    def strike(faulty: Faulty) -> float:
        library = faketime()
        words = f"env LD_PRELOAD={library} FAKETIME={offset} FAKETIME_DONT_FAKE_MONOTONIC=1 FAKETIME_NO_CACHE=1"
        faulty.wrap(name, words)
        time.sleep(3.0)
        return faulty.wrap(name, "")

    return Fault(f"clock of {_kind(name)} {offset}", "exploring", strike, (name,), "faketime")


def _full(faulty: Faulty) -> float:
    with faulty.full_disk():
        time.sleep(5.0)
    return max(faulty.time_until_heard(name) for name in ("fusion", "planner", "recorder"))


def _full_and_killed(name: str) -> Fault:
    def strike(faulty: Faulty) -> float:
        with faulty.full_disk():
            faulty.system.kill(name)
            time.sleep(2.0)
        return faulty.time_until_heard(name)

    return Fault(f"disk full, then kill -9 {_kind(name)}", "exploring", strike, (name,), "small disk")


def _corrupt(name: str, store: str, may_fail: str = "") -> Fault:
    def strike(faulty: Faulty) -> float:
        faulty.corrupt(store)
        return faulty.system.kill(name)

    return Fault(f"store of {_kind(name)} corrupted, then kill -9", "exploring", strike, (name,), may_fail=may_fail)


def _kind(name: str) -> str:
    return name.partition("-")[0]


FAULTS: tuple[Fault, ...] = (
    *(_kill(name, phase) for phase in ("exploring", "approaching") for name in SERVICES),  # type: ignore[arg-type]
    *(_freeze(name) for name in SERVICES),
    *(_cut(name) for name in ("robot", "fusion", "planner", "perception", "camera-c0-1")),
    _clock("camera-c0-1", "+3600s"),
    _clock("robot", "+3600s"),
    _clock("fusion", "-3600s"),
    Fault("disk of the stores full for 5 s", "exploring", _full, (), "small disk"),
    _full_and_killed("fusion"),
    _full_and_killed("planner"),
    _corrupt("fusion", "fusion.sqlite"),
    _corrupt("planner", "planner.sqlite", may_fail="mission_lost"),  # the only place where the mission was
)


def why_not(fault: Fault, faulty: Faulty) -> str:
    """Why a fault can't be played here; "" if it can."""
    if fault.needs == "network" and not faulty.has_network:
        return "no network namespace can be made here"
    if fault.needs == "small disk" and not faulty.has_small_disk:
        return "no tmpfs can be mounted here"
    if fault.needs == "faketime" and faketime() is None:
        return "libfaketime can't be had here"
    return ""


def play(fault: Fault, faulty: Faulty) -> Played:
    """Has a mission run into a fault, and sees how both end.

    Raises:
        AssertionError, httpx.HTTPError: the mission never got so far, the service never came back, or the mission didn't end.
    """
    if not fault.apart:
        return _play(fault, faulty)
    faulty.wrap(fault.apart, f"ip netns exec {NETWORK}")
    try:
        return _play(fault, faulty)
    finally:
        faulty.wrap(fault.apart, "")


def _play(fault: Fault, faulty: Faulty) -> Played:
    system = faulty.system
    search = _search_until_it_is_time(fault, faulty)
    before = system.services()
    search.longest_s = 0.0
    with ThreadPoolExecutor(1) as pool:
        strike = pool.submit(fault.strike, faulty)
        end = search.until(lambda _: False, END_S)
        took_s = time.monotonic() - search.began_s
        recovery_s = strike.result()
    wrong = [f"store damaged: {what}" for what in _damaged_for_good(faulty)]
    if end["state"] != "done" and not end.get("error"):
        wrong.append(f"ended as {end['state']} without a reason")
    for name, service in system.services().items():
        known = before.get(name, {"restarts": 0})["restarts"]
        if service["restarts"] > known and name not in fault.may_end:
            wrong.append(f"{name} ended, too: {service['why']}")
    missing = [name for name in SERVICES if system.pid(name) is None]
    wrong += [f"{name} doesn't run" for name in missing]
    error = str(end.get("error") or "")
    return Played(
        fault.name, str(end["state"]), bool(end["found"]), error, recovery_s, took_s, tuple(wrong), search.longest_s
    )


def _search_until_it_is_time(fault: Fault, faulty: Faulty) -> Search:
    """A search that is in the phase in which the fault shall happen. One that is over before is followed by another one."""
    for _ in range(3):
        if fault.phase == "exploring":
            faulty.forget_maps()
        target = _TARGETS[faulty.n_searches % len(_TARGETS)]  # never twice the same in a row: the robot stands there
        faulty.n_searches += 1
        search = Search(faulty.system, faulty.system.search(target))
        last = search.until(lambda last: last.get("phase") in _PHASES[fault.phase], 90)
        if last["state"] not in FINISHED_STATES:
            return search
    raise AssertionError(f"three searches were over before they were {fault.phase}: {last}")


def _damaged_for_good(faulty: Faulty) -> list[str]:
    """What is wrong with the stores after services have had the time to set damaged ones aside."""
    end_s = time.monotonic() + 10.0
    while (found := faulty.damaged_stores()) and time.monotonic() < end_s:
        time.sleep(0.5)
    return found


class Search:
    """A mission that is followed through the gateway.

    Attributes:
        longest_s: the longest time for which it made no step.
    """

    def __init__(self, system: Up, id: str) -> None:
        self._system, self._id = system, id
        self._last: dict[str, Any] = {}
        self.began_s = self._moved_s = time.monotonic()
        self.longest_s = 0.0

    def until(self, reached: Callable[[dict[str, Any]], bool], timeout_s: float) -> dict[str, Any]:
        """Follows the mission until that is reached, or until it has ended; returns what it is like then."""
        end_s = time.monotonic() + timeout_s
        while not (reached(self._last) or self._last.get("state") in FINISHED_STATES):
            assert time.monotonic() < end_s, f"neither reached nor over: {self._last}\n{self._system.said}"
            time.sleep(_LOOK_S)
            newest = self._system.mission(self._id) or self._last
            now_s = time.monotonic()
            if newest.get("step") != self._last.get("step"):
                self.longest_s, self._moved_s = max(self.longest_s, now_s - self._moved_s), now_s
            self._last = newest
        return self._last
