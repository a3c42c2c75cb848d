"""Settings of the planner service, from environment variables ``SURVEILNAV_PLANNER__<FIELD>``.

Those of the core (``core/config.py``) are nested: ``SURVEILNAV_PLANNER__CORE__STRATEGY=greedy``.
"""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.services.planner.core import PlannerConfig


class PlannerSettings(BaseSettings):
    """How long the planner waits for other services, how it plans, and where it stores its missions."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_PLANNER__", env_nested_delimiter="__", extra="ignore")

    core: PlannerConfig = Field(default=PlannerConfig(), description="how it plans")
    store: str = Field(
        default="", description="the SQLite file that missions are stored in; empty: they don't survive a restart"
    )
    building_file: str = Field(
        default="",
        description="the file of the building, `building.yaml`: its keepout zones, doors and lifts; changes are "
        "noticed",
    )
    first_look_s: float = Field(
        default=0.0,
        ge=0,
        le=50,
        description="a robot waits at most so long until all views of its floor's cameras were looked at for the target; 0: it "
        "drives off at once, and the views come while it drives",
    )
    maps_timeout_s: float = Field(
        default=120.0, gt=0, description="a mission fails if the maps with its robot's view take longer"
    )
    robot_timeout_s: float = Field(
        default=120.0, gt=0, description="a mission fails if its robot doesn't answer for this long"
    )
    late_s: float = Field(
        default=3.0, gt=0, description="the mission's status says what it is waiting for after this time"
    )
    ask_timeout_s: float = Field(default=2.0, gt=0, description="timeout of a query to another service")
    command_deadline_s: float = Field(
        default=60.0, gt=0, description="the robot stops if it receives no command for this long"
    )
    drive_deadline_s: float = Field(
        default=10.0,
        gt=0,
        description="a robot that drives to a waypoint by itself stops if it receives no command for this long",
    )
    decision_period_s: float = Field(
        default=1.0,
        gt=0,
        description="while a robot drives to a waypoint by itself, the next decision is made after this time at the latest",
    )
    min_battery: float = Field(
        default=0.15,
        ge=0,
        le=1,
        description="a robot whose battery is less full than this gets no new mission; the one that it is on goes on",
    )
    max_steps: int = Field(default=5000, ge=1, description="the most steps that a mission may ask for")
    max_queued: int = Field(default=100, ge=0, description="how many missions may wait for a robot")
    finished_missions_kept: int = Field(
        default=1000, ge=1, description="how many finished missions are stored; the oldest are deleted first"
    )
