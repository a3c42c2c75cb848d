"""How many bytes a building's network will need: from what views, steps and waiting were measured to cost.

An hour is drawn many times: the number of missions (Poisson), the steps of each (log-normal) and the size of the building's
views. A mission's cameras send every view once, and again ``hz`` times a second if what they see changes; cameras that the maps
know already, because a robot has waited on their floor, send nothing, so that this is the most that still cameras cost. The costs
are in ``data/traffic_costs.json``; docs/results/bandwidth.md says how they were measured, and holds a forecast against a run.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files

import msgspec
import numpy as np
from numpy.typing import NDArray

from surveilnav.errors import ConfigError
from surveilnav.messages import Tier, TierChoice

_DRAWS = 4000
#: Of the interval.
_LOW, _HIGH = 5.0, 95.0
LINKS = ("camera", "robot", "server")


class TrafficCosts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What was measured. Pairs are a mean and a standard deviation.

    Attributes:
        view_bytes: of a view on the wire, by tier; the deviation is that of views in one building.
        building_share: by how much the mean of a building's views differs, as a share of it.
        robot_step_bytes, server_step_bytes: what robots and servers send in a step of a mission.
        steps: of a mission. ``step_s``: how long one takes.
        idle_bytes_s: of each camera, of each robot, and of all servers, while nothing happens.
    """

    view_bytes: dict[Tier, tuple[float, float]]
    building_share: float
    robot_step_bytes: tuple[float, float]
    server_step_bytes: tuple[float, float]
    steps: tuple[float, float]
    step_s: float
    idle_bytes_s: dict[str, float]


@dataclass(frozen=True, slots=True)
class Plan:
    """What a building is to do.

    Attributes:
        cameras: in the building; ``views`` of each; ``tier`` of all.
        cameras_per_mission: how many are invoked by one: those of its floors.
        robots: that wait or search.
        hz: how often a second the picture of an invoked view changes; 0: what the cameras see stands still.
    """

    cameras: int
    tier: TierChoice
    missions_per_hour: float
    views: int = 13
    cameras_per_mission: int = 0
    robots: int = 1
    hz: float = 0.0

    def check(self) -> None:
        """ConfigError: numbers that no building has."""
        counts = self.cameras, self.views, self.robots, self.cameras_per_mission
        if min(counts) < 0 or min(self.cameras, self.views) < 1 or self.cameras_per_mission > self.cameras:
            raise ConfigError(
                "expected at least one camera with one view, and no more cameras a mission than there are, got "
                f"{self.cameras} cameras, {self.views} views, {self.cameras_per_mission} cameras a mission"
            )
        if not (0.0 <= self.missions_per_hour <= 10_000.0 and 0.0 <= self.hz <= 100.0):  # False for NaN
            got = f"{self.missions_per_hour} and {self.hz}"
            raise ConfigError(f"expected 0 to 10,000 missions an hour and 0 to 100 pictures a second, got {got}")


@dataclass(frozen=True, slots=True)
class Need:
    """What goes over a kind of link: bytes of a mission, and of an hour, whose interval holds nine of ten hours."""

    mission_bytes: float
    hour_bytes: float
    hour_low_bytes: float
    hour_high_bytes: float


def measured_costs() -> TrafficCosts:
    """The costs that come with the program."""
    data = files("surveilnav.data").joinpath("traffic_costs.json").read_bytes()
    return msgspec.json.decode(data, type=TrafficCosts)


def forecast(plan: Plan, costs: TrafficCosts, seed: int = 0) -> dict[str, Need]:
    """By kind of link ("camera", "robot", "server"), what ``plan`` needs; the same for the same seed.

    Raises:
        ConfigError: the plan has numbers that no building has.
    """
    plan.check()
    random = np.random.default_rng(seed)
    n_missions = random.poisson(plan.missions_per_hour, _DRAWS)
    steps = _of_hours(random, n_missions, *costs.steps)
    missions = np.maximum(n_missions, 1)
    pictures = _pictures(plan, steps.sum(axis=1) * costs.step_s / missions)
    of_view = _of_view(random, plan, costs)
    per_mission = {
        "camera": of_view * pictures,
        "robot": _each_step(random, steps, costs.robot_step_bytes) / missions,
        "server": _each_step(random, steps, costs.server_step_bytes) / missions,
    }
    idle = {
        "camera": plan.cameras * costs.idle_bytes_s["camera"],
        "robot": plan.robots * costs.idle_bytes_s["robot"],
        "server": costs.idle_bytes_s["server"],
    }
    return {link: _need(n_missions, per_mission[link], 3600.0 * idle[link]) for link in LINKS}


def _pictures(plan: Plan, mission_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """How many pictures a mission's cameras send, by draw."""
    invoked = plan.cameras_per_mission or plan.cameras
    return invoked * plan.views * (1.0 + plan.hz * mission_s)


def _of_view(random: np.random.Generator, plan: Plan, costs: TrafficCosts) -> NDArray[np.float64]:
    """The mean bytes of the building's views, by draw."""
    tier: Tier = "features" if plan.tier == "auto" else plan.tier
    mean, deviation = costs.view_bytes[tier]
    n_views = (plan.cameras_per_mission or plan.cameras) * plan.views
    spread = np.hypot(mean * costs.building_share, deviation / np.sqrt(n_views))
    return np.maximum(random.normal(mean, spread, _DRAWS), 0.1 * mean)


def _of_hours(
    random: np.random.Generator, n_missions: NDArray[np.int64], mean: float, deviation: float
) -> NDArray[np.float64]:
    """Log-normal numbers (draws, missions) with these moments; 0 where an hour has fewer missions."""
    variance = np.log1p((deviation / mean) ** 2)
    most = max(int(n_missions.max(initial=0)), 1)
    numbers = random.lognormal(np.log(mean) - variance / 2, np.sqrt(variance), (_DRAWS, most))
    return np.where(np.arange(most) < n_missions[:, None], numbers, 0.0)


def _each_step(
    random: np.random.Generator, steps: NDArray[np.float64], bytes_of_step: tuple[float, float]
) -> NDArray[np.float64]:
    total: NDArray[np.float64] = np.maximum(random.normal(*bytes_of_step, _DRAWS), 0.0) * steps.sum(axis=1)
    return total


def _need(n_missions: NDArray[np.int64], per_mission: NDArray[np.float64], idle_bytes: float) -> Need:
    hours = n_missions * per_mission + idle_bytes
    some = n_missions > 0
    low, high = np.percentile(hours, [_LOW, _HIGH])
    mission = float(per_mission[some].mean()) if some.any() else 0.0
    return Need(mission, float(hours.mean()), float(low), float(high))
