"""A golden run: a dozen fixed searches, and whether the program still plays them action by action as it did.

    python -m surveilnav.benchmark.canary            # plays them; exit 1 if one came out another way
    python -m surveilnav.benchmark.canary --renew    # the new way is meant: write it down, and say why in CHANGELOG.md

``canary.json`` has the searches and what they did. Its digest covers success, steps, actions, path in millimetres and
reason of failure; renaming, messages, bytes and seconds don't touch it. Numbers of runs are stamped with it
(``runner.basis``). Searches on pixels are played and printed, but don't gate: detectors' sums differ by processor.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import time
from collections.abc import Sequence
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec

from surveilnav.benchmark.play.workers import in_workers
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.errors import ConfigError

if TYPE_CHECKING:
    from surveilnav.simulator.simulation import SimulatedBuilding
    from surveilnav.simulator.world.goals import Goals, Start

FILE = Path(__file__).with_name("canary.json")
#: One letter an action, so that a search reads as a line.
_LETTERS = {
    "move_forward": "F",
    "turn_left": "L",
    "turn_right": "R",
    "look_up": "U",
    "look_down": "D",
    "take_stairs": "T",
    "stop": "S",
}
_POLL_S = 1.0


class Place(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where a robot begins: on a floor at x, y [m, world], facing ``yaw_rad``."""

    floor: str
    x_m: float
    y_m: float
    yaw_rad: float


class Outcome(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What a search did. ``actions``: a letter for each, a number before those that repeat: ``12L3FS``."""

    success: bool
    steps: int
    path_mm: int
    reason: str
    actions: str


class Search(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One search. ``run``: what differs from ``RunSettings``' defaults; ``did``: what it came to, None if it doesn't gate."""

    name: str
    building: str
    seed: int
    cameras: int
    target: str
    start: Place
    run: dict[str, Any]
    did: Outcome | None = None


class Canary(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``canary.json``."""

    digest: str
    searches: list[Search]


@cache
def digest() -> str:
    """What the program does, in 12 hexadecimal digits: stamped on runs and pages. ConfigError: the file can't be read."""
    return read().digest


def read(file: Path = FILE) -> Canary:
    """The searches. ConfigError: the file can't be read, or its digest isn't that of what it says."""
    try:
        canary = msgspec.json.decode(file.read_bytes(), type=Canary)
    except (OSError, msgspec.DecodeError) as error:
        raise ConfigError(f"{file} can't be read: {error}") from error
    if canary.digest != digest_of(canary.searches):
        raise ConfigError(
            f"{file} says digest {canary.digest}, its searches make {digest_of(canary.searches)}: was it edited?"
        )
    return canary


def digest_of(searches: Sequence[Search]) -> str:
    """Of what the gating searches did."""
    did = [(s.name, *msgspec.structs.astuple(s.did)) for s in searches if s.did is not None]
    return hashlib.sha256(msgspec.json.encode(did)).hexdigest()[:12]


def open_search(golden: Search, n_cameras: int | None = None) -> tuple[SimulatedBuilding, Goals, Start]:
    """The building of a search, what is searched in it, and where the robot begins. Raises what opening a building may.

    Args:
        n_cameras: of the building; None: as many as the golden run has there.
    """
    from surveilnav.simulator.simulation import SimulatedBuilding, SimulationSettings
    from surveilnav.simulator.world.goals import Start, find_goals

    cameras = golden.cameras if n_cameras is None else n_cameras
    building = SimulatedBuilding(
        SimulationSettings(building=golden.building, seed=golden.seed, cameras=cameras, lighting="flat")
    )
    navigation, at = building.navigation, golden.start
    goals = find_goals(building.scene, navigation, golden.target, caster=building.caster)
    p_m = (at.x_m, at.y_m, navigation.floors[at.floor].z_m)
    return building, goals, Start(p_m, at.floor, at.yaw_rad, goals.field.at((at.x_m, at.y_m), at.floor))


def play(golden: Search) -> Outcome:
    """Plays one. Raises what opening its building may, and PerceptionError where its detector can't be had."""
    from surveilnav.benchmark.runner.search import search, sight_of
    from surveilnav.simulator.truth.choose import choose_backend

    settings = msgspec.convert(golden.run, RunSettings)
    building, goals, start = open_search(golden)
    backend = choose_backend(settings.perception, seed=settings.seed, harder=settings.harder)
    actions: list[str] = []
    episode = search(
        sight_of(building, backend, settings),
        settings,
        goals,
        start,
        seed=1,
        goal_on_floor=start.floor in goals.viewpoints,
        on_step=lambda *step: actions.append(step[-1].action or ""),
    )
    return Outcome(
        success=episode.verdict.success,
        steps=episode.steps,
        path_mm=round(1e3 * episode.verdict.path_m),
        reason=episode.reason,
        actions=_written(actions),
    )


def _written(actions: Sequence[str]) -> str:
    runs = [(letter, len(list(same))) for letter, same in groupby(_LETTERS[a] for a in actions if a)]
    return "".join(f"{n if n > 1 else ''}{letter}" for letter, n in runs)


def _differs(was: Outcome, now: Outcome) -> str:
    """How, for people; empty if not at all."""
    facts = [
        f"{name} {before!r} is {after!r}"
        for name in ("success", "steps", "path_mm", "reason")
        if (before := getattr(was, name)) != (after := getattr(now, name))
    ]
    if was.actions != now.actions:
        both = enumerate(zip(was.actions, now.actions, strict=False))
        same = next((i for i, (a, b) in both if a != b), min(len(was.actions), len(now.actions)))
        facts.append(
            f"after {was.actions[max(0, same - 12) : same]!r} came {was.actions[same : same + 8]!r}, "
            f"comes {now.actions[same : same + 8]!r}"
        )
    return "; ".join(facts)


def main(argv: Sequence[str] | None = None) -> int:
    """Plays the searches that are named, else all; 0 if what gates came out as written."""
    parser = _parser()
    args = parser.parse_args(argv)
    if args.renew and (args.names or args.no_pixels):
        parser.error("--renew writes down what all searches do: name none, and leave none out")
    canary = msgspec.json.decode(FILE.read_bytes(), type=Canary) if args.renew else read()
    wanted = [
        s
        for s in canary.searches
        if (not args.names or s.name in args.names) and not (args.no_pixels and needs_weights(s))
    ]
    if unknown := set(args.names) - {s.name for s in wanted}:
        parser.error(f"there is no search {min(unknown)!r}; there are {', '.join(s.name for s in canary.searches)}")
    began_s, failed, done = time.monotonic(), False, dict[str, Outcome]()
    for ended in in_workers(play, wanted, args.workers, _POLL_S):
        if ended is None:
            continue
        search, now = ended.job, ended.result
        if now is not None:
            done[search.name] = now
        trouble = ended.why or (search.did and now and _differs(search.did, now)) or ""
        failed |= bool(trouble) and not needs_weights(search) and (not args.renew or bool(ended.error))
        at = f"[{len(done)}/{len(wanted)} {time.monotonic() - began_s:4.0f} s]"
        print(f"{at} {search.name}: {_came_to(search, now, trouble)}", flush=True)
    if args.renew and not failed and len(wanted) == len(canary.searches):
        _write([msgspec.structs.replace(s, did=None if needs_weights(s) else done[s.name]) for s in canary.searches])
    if failed:
        print(
            "the program doesn't search as it did; if that is meant: make canary ARGS=--renew, and say why in CHANGELOG.md"
        )
    elif not args.names:
        print(f"digest {read().digest}, {time.monotonic() - began_s:.0f} s")
    return int(failed)


def _came_to(search: Search, now: Outcome | None, trouble: str) -> str:
    """For people: what a search did, and whether that is as written."""
    gates = not needs_weights(search)
    how = "the same" if gates and not trouble else trouble or "doesn't gate"
    if now is None:
        return f"; {how}"
    return f"{'found' if now.success else now.reason} in {now.steps} steps, {now.path_mm / 1e3:.2f} m; {how}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="surveilnav.benchmark.canary", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", help="only these searches")
    parser.add_argument("--renew", action="store_true", help="write down what all of them do now")
    parser.add_argument("--no-pixels", action="store_true", help="leave out what doesn't gate")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    return parser


def needs_weights(search: Search) -> bool:
    """Whether it looks at pixels."""
    return search.run.get("perception", "simulated") not in ("simulated", "oracle")


def _write(searches: list[Search]) -> None:
    text = msgspec.json.format(msgspec.json.encode(Canary(digest=digest_of(searches), searches=searches)), indent=1)
    FILE.write_bytes(text + b"\n")


if __name__ == "__main__":
    sys.exit(main())
