"""``surveilnav find``: a mission is submitted and followed to its end."""

from __future__ import annotations

import time

from rich.console import Console
from rich.markup import escape

from surveilnav.cli.mission_words import said_of, state_of, steps_of
from surveilnav.cli.words import duration, metres
from surveilnav.client import Client
from surveilnav.errors import GatewayError
from surveilnav.rest import Mission
from surveilnav.words import canonical

#: Planner or gateway may be away for so long: whoever keeps them running starts them again.
_LOST_S = 20.0
_EVERY_S = 0.5


def follow_mission(
    gateway: Client, target: str, robot: str, max_steps: int, console: Console, *, queue: bool = False
) -> Mission:
    """Submits a mission and shows its progress to the end; the mission's last state. ``queue``: it waits for a robot."""
    mission = gateway.submit(target, robot or None, max_steps, queue=queue)
    try:
        if canonical(target) != canonical(mission.target):
            console.print(f"{target}: perception calls it {mission.target}", markup=False)
        mission = _followed(gateway, mission.id, console)
    except KeyboardInterrupt:
        gateway.cancel(mission.id)
        console.print("cancelled: the robot stops")
        raise
    state, style = state_of(mission)
    console.print(f"[{style or 'red'}]{state}[/] {escape(said_of(mission))}", soft_wrap=not console.is_terminal)
    return mission


def _followed(gateway: Client, id: str, console: Console) -> Mission:
    """The finished mission; until then a line for each change."""
    shown, heard_s = "", time.monotonic()
    while True:
        mission = _asked(gateway, id, heard_s)
        if mission is not None:
            line = _line(mission)
            if line != shown:
                shown = line
                console.print(line, markup=False, soft_wrap=not console.is_terminal)
            if mission.has_ended:
                return mission
            heard_s = heard_s if mission.stale else time.monotonic()
            if time.monotonic() - heard_s > _LOST_S:
                raise GatewayError(
                    "stale",
                    f"the planner hasn't been heard of for {_LOST_S:.0f} s: see `surveilnav status` and its log. Mission {id} "
                    "goes on when it is back",
                )
        time.sleep(_EVERY_S)


def _asked(gateway: Client, id: str, heard_s: float) -> Mission | None:
    """The mission now; None while the gateway may be on its way back. GatewayError: it stays away, or refuses."""
    try:
        return gateway.mission(id)
    except GatewayError as error:
        if error.name != "no_gateway" or time.monotonic() - heard_s > _LOST_S:
            raise
        return None


def _line(mission: Mission) -> str:
    left = duration(mission.time_remaining_s)
    way = "".join(f", {part}" for part in (metres(mission.path_m), left and f"{left} to the waypoint") if part)
    return f"{mission.phase or mission.state}  step {steps_of(mission)}{way}  {mission.message}".rstrip()
