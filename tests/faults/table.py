"""Every kind of fault, and how one is played: in the midst of a search, until the search has ended."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from surveilnav.messages import FINISHED_STATES
from tests.e2e.kills import SERVICES
from tests.faults.system import NETWORK, Faulty, faketime
from tests.waiting import until

Phase = Literal["exploring", "approaching"]
FROZEN_S = CUT_S = 10.0
_TARGETS = ("tv", "bed")
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
        needs: what it takes: "network", "small disk" or "faketime"; "" nothing.
        rare: whether it is only played by `make soak`, because another one is much like it.
    """

    name: str
    phase: Phase
    strike: Callable[[Faulty], float]
    may_end: tuple[str, ...] = ()
    needs: str = ""
    rare: bool = False


@dataclass(frozen=True)
class Played:
    """What became of a mission during which a fault happened.

    Attributes:
        state, error: of the mission; "" for no error.
        recovery_s: until the service that was struck was back.
        mission_s: how long the mission took.
        wrong: what should not have been.
    """

    fault: str
    state: str
    found: bool
    error: str
    recovery_s: float
    mission_s: float
    wrong: tuple[str, ...] = ()


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
        faulty.wrap(name, f"ip netns exec {NETWORK}")
        faulty.cut(CUT_S)
        back_s = faulty.time_until_heard(name)
        faulty.wrap(name, "")
        return back_s

    return Fault(
        f"network of {_kind(name)} cut for 10 s",
        "exploring",
        strike,
        (name,),
        "network",
        rare=name not in ("robot", "fusion"),
    )


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


def _corrupt(name: str, store: str) -> Fault:
    def strike(faulty: Faulty) -> float:
        faulty.corrupt(store)
        return faulty.system.kill(name)

    return Fault(f"store of {_kind(name)} corrupted, then kill -9", "exploring", strike, (name,))


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
    _corrupt("planner", "planner.sqlite"),
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


def play(fault: Fault, faulty: Faulty, number: int = 0) -> Played:
    """Has a mission run into a fault, and sees how both end."""
    system = faulty.system
    if fault.phase == "exploring":
        faulty.forget_maps()
    before = system.services()
    id = system.search(_TARGETS[number % len(_TARGETS)])
    began_s = time.monotonic()
    last: dict[str, object] = {}

    def reached() -> bool:
        nonlocal last
        last = system.mission(id) or last
        return last.get("phase") == fault.phase or last.get("state") in FINISHED_STATES

    until(reached, lambda: f"it never was {fault.phase}: {last}\n{system.said}", 90)
    recovery_s = fault.strike(faulty)
    end = system.end(id, timeout_s=240)
    wrong = [f"store damaged: {what}" for what in faulty.damaged_stores()]
    if end["state"] != "done" and not end.get("error"):
        wrong.append(f"ended as {end['state']} without a reason")
    for name, service in system.services().items():
        known = before.get(name, {"restarts": 0})["restarts"]
        if service["restarts"] > known and name not in fault.may_end:
            wrong.append(f"{name} ended, too: {service['why']}")
    missing = [name for name in SERVICES if system.pid(name) is None]
    wrong += [f"{name} doesn't run" for name in missing]
    error = str(end.get("error") or "")
    took_s = time.monotonic() - began_s
    return Played(fault.name, str(end["state"]), bool(end["found"]), error, recovery_s, took_s, tuple(wrong))
