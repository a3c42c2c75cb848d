"""The second look around: what was only glanced at from afar may be the target after all."""

from __future__ import annotations

import math

import cv2
import numpy as np

from services.planner.core import memory
from services.planner.core.now import Now
from services.planner.core.state import Decision
from surveilnav.messages import Candidate

_MAX_TRIES = 64


def sweep(now: Now) -> Decision | None:
    """All is explored and the target wasn't seen: looks all around once more from places far from earlier such looks,
    the most promising and nearest first. None when no such place is left."""
    state, config, robot, terrain = now.state, now.config, now.robot, now.terrain
    if config.sweep_m <= 0:
        return None
    if state.sweep_left and math.dist((robot.x_m, robot.y_m), state.here.scans[-1]) < config.reached_m:
        state.sweep_left -= 1
        memory.rest(state)
        return now.decide("turn_left", "sweeping", f"looking around once more, {state.sweep_left} turns to go")
    state.sweep_left = 0
    for _ in range(_MAX_TRIES):
        place = _place(now)
        if place is None:
            return None
        if math.dist(place, (robot.x_m, robot.y_m)) <= config.reached_m:
            state.here.scans.append((robot.x_m, robot.y_m))
            state.sweep_left = config.scan_turns - 1
            return now.decide("turn_left", "sweeping", "looking around once more")
        now.commit(Candidate("sweep", *place, 0.0, True, "far from every look around"))
        route = now.drive(terrain.disc(*place, 0.2) & np.isfinite(now.arrival))
        if route is not None:
            message = f"to look around once more, {route.remaining_m:.1f} m"
            return now.level() or now.decide(route.action, "sweeping", message, route)
        state.here.scans.append(place)  # it can't be got to: as good as looked at
    return None


def _place(now: Now) -> tuple[float, float] | None:
    """Where to look around next; the present choice is kept while it stands."""
    state, config, terrain, held = now.state, now.config, now.terrain, now.state.commitment
    unseen = np.ones(terrain.grid.shape, dtype=np.uint8)
    for x_m, y_m in state.here.scans:
        unseen[terrain.disc(x_m, y_m, config.sweep_m)] = 0
    places = (unseen != 0) & terrain.known & np.isfinite(now.arrival) & (terrain.speed > config.tight_speed)
    if held is not None and held.kind == "sweep" and places[terrain.cell(held.x_m, held.y_m)]:
        return held.x_m, held.y_m
    if not places.any():
        return None
    value = np.nan_to_num(terrain.crop(now.maps.value), nan=0.0)
    window = 2 * round(1.0 / terrain.grid.resolution_m) + 1
    score = cv2.blur(value.astype(np.float32), (window, window)) - config.distance_weight_per_m * now.arrival
    row, col = np.unravel_index(int(np.argmax(np.where(places, score, -np.inf))), score.shape)
    return terrain.place(int(row), int(col))
