"""The live screen: pure, from what is known to lines that fit the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import datetime

from rich.text import Text

from surveilnav.cli.cameras import state_of as camera_state
from surveilnav.cli.mission_words import said_of, state_of, steps_of
from surveilnav.cli.terminal import plain
from surveilnav.cli.watching.system_state import SystemState
from surveilnav.cli.words import duration, human_bytes, metres
from surveilnav.rest import Mission

_BAR = 8
_LIGHTS = {"invoked": ("●", "bold green"), "idle": ("○", ""), "paused": ("◌", "yellow"), "offline": ("✕", "bold red")}
#: So many lines of each at most; in a low terminal fewer.
_MISSIONS, _SOURCES, _ALERTS = 3, 6, 4

Alert = tuple[str, datetime]


def screen(
    known: SystemState,
    alerts: Sequence[Alert],
    events: Sequence[str],
    *,
    url: str,
    now: datetime,
    width: int,
    height: int,
) -> list[Text]:
    """At most ``height`` lines, none wider than ``width``. Alerts and missions come first; the newest events have what is left.

    Args:
        alerts: what is wrong, and since when.
        events: a line each, the newest last.
    """
    lines = [_header(known, url, now), *_alerts(alerts), *_missions(known), *_robots(known), *_cameras(known, width)]
    lines += _traffic(known)
    room = height - len(lines) - 1
    if room > 0 and events:
        lines += [_title("events"), *(Text(plain(line)) for line in events[-room:])]
    for line in lines:
        line.no_wrap = True
        line.truncate(width, overflow="ellipsis")
    return lines[:height]


def _title(name: str) -> Text:
    return Text(name, style="bold underline")


def _header(known: SystemState, url: str, now: datetime) -> Text:
    names = ", ".join(building.id for building in known.buildings) or "…"
    return Text.assemble(
        ("surveilnav", "bold"), f"  {plain(names)}  {url}  {now.astimezone():%H:%M:%S}  ", ("Ctrl-C ends", "dim")
    )


def _alerts(alerts: Sequence[Alert]) -> Iterator[Text]:
    for what, since in alerts[:_ALERTS]:
        yield Text(f"! {plain(what)}, since {since.astimezone():%H:%M:%S}", style="bold red")
    if len(alerts) > _ALERTS:
        yield Text(f"! and {len(alerts) - _ALERTS} more", style="bold red")


def _missions(known: SystemState) -> Iterator[Text]:
    yield _title("missions")
    under_way = known.under_way
    if not under_way:
        ended = known.missions[:1]
        yield from (_ended(mission) for mission in ended)
        if not ended:
            yield Text("none yet: surveilnav find TARGET", style="dim")
    for mission in under_way[:_MISSIONS]:
        yield _under_way(mission)
        yield Text(f"  {plain(_why(known, mission))}", style="dim")
    if len(under_way) > _MISSIONS:
        yield Text(f"and {len(under_way) - _MISSIONS} more", style="dim")


def _under_way(mission: Mission) -> Text:
    state, style = state_of(mission)
    left = duration(mission.time_remaining_s)
    facts = [steps_of(mission), metres(mission.path_m), f"waypoint in {left}" if left else ""]
    return Text.assemble(
        f"{plain(mission.id)}  ",
        (plain(mission.target), "bold"),
        "  ",
        (state, style),
        f" {_bar(mission)} ",
        "  ".join(fact for fact in facts if fact),
    )


def _bar(mission: Mission) -> str:
    """How many of its steps are used up."""
    full = round(_BAR * min(1.0, mission.step / (mission.max_steps or mission.step or 1)))
    return "━" * full + "┈" * (_BAR - full)


def _why(known: SystemState, mission: Mission) -> str:
    """Why the waypoint was chosen, else what the mission says of itself."""
    plan = known.plans.get(mission.id)
    if plan is None:
        return said_of(mission) or mission.phase
    chosen = next((place.note for place in plan.candidates if place.chosen), "")
    others = len(plan.candidates) - 1
    weighed = f", {others} other{'s' if others > 1 else ''} weighed" if others > 0 else ""
    return plan.why + (f" ({chosen})" if chosen else "") + weighed


def _ended(mission: Mission) -> Text:
    state, style = state_of(mission)
    said = f"{steps_of(mission)}  {metres(mission.path_m)}  {said_of(mission)}"
    return Text.assemble(
        f"{plain(mission.id)}  ", (plain(mission.target), "bold"), "  ", (state, style), f"  {plain(said)}"
    )


def _robots(known: SystemState) -> Iterator[Text]:
    yield _title("robots")
    for robot in known.robots[:_MISSIONS]:
        state = ("silent", "red") if robot.stale else (robot.state, "")
        x_m, y_m, _ = robot.position_m
        what = f"{robot.mission or 'free'}  {robot.message}"
        yield Text.assemble(
            f"{plain(robot.id)}  ", state, f"  floor {robot.floor} at {x_m:.1f}, {y_m:.1f}  {plain(what)}"
        )
    if len(known.robots) > _MISSIONS:
        yield Text(f"and {len(known.robots) - _MISSIONS} more", style="dim")


def _cameras(known: SystemState, width: int) -> Iterator[Text]:
    """Lights, as many in a line as fit."""
    states = [camera_state(camera)[0] for camera in known.cameras]
    counts = ", ".join(f"{states.count(state)} {state}" for state in _LIGHTS if state in states)
    yield Text.assemble(_title("cameras"), f"  {counts}")
    line = Text()
    for camera, state in zip(known.cameras, states, strict=True):
        light, style = _LIGHTS[state]
        lamp = Text.assemble((light, style), f" {plain(camera.id)}  ")
        if line.cell_len + lamp.cell_len > width and line:
            yield line
            line = Text()
        line.append_text(lamp)
    if line:
        yield line


def _traffic(known: SystemState) -> Iterator[Text]:
    """The three numbers of the busiest sources, and of all."""
    if known.traffic is None:
        return
    yield Text.assemble(_title("traffic"), ("    offered  delivered       wire      now", "dim"))
    sources = [(f"camera/{s.id}", s) for s in known.traffic.cameras] + [
        (f"robot/{s.id}", s) for s in known.traffic.robots
    ]
    sources.sort(key=lambda named: (-known.rates.get(named[0], 0.0), -named[1].offered_bytes))
    for name, source in sources[:_SOURCES]:
        counts = _columns(source.offered_bytes, source.delivered_bytes, source.wire_sent_bytes)
        yield Text(f"{counts}  {human_bytes(round(known.rates.get(name, 0.0))):>7}/s  {plain(name)}")
    total = (known.traffic.offered_bytes, known.traffic.delivered_bytes, known.traffic.wire_sent_bytes)
    yield Text(f"{_columns(*total)}  {'':9}  all processes")


def _columns(*counts: int | None) -> str:
    return " " * 7 + " ".join(f"{human_bytes(count):>10}" for count in counts)
