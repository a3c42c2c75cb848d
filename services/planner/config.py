"""Settings of the planner service: environment variables ``SURVEILNAV_PLANNER__<FIELD>``, those of the core by ``__``.

``SURVEILNAV_PLANNER__CORE__STRATEGY=greedy`` changes one number of ``surveilnav.services.planner.core.config``.
"""

from __future__ import annotations

from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav.services.planner.core import PlannerConfig


class PlannerSettings(BaseSettings):
    """How long the planner waits for others, how it plans, and where its missions are kept."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_PLANNER__", env_nested_delimiter="__", extra="ignore")

    core: PlannerConfig = Field(default=PlannerConfig(), description="how it plans")
    store: str = Field(
        default="", description="the SQLite file that missions are kept in; empty: they don't outlive the planner"
    )
    maps_timeout_s: float = Field(default=120.0, gt=0, description="maps later than this fail a mission")
    robot_timeout_s: float = Field(default=120.0, gt=0, description="a robot silent for longer is lost")
    late_s: float = Field(default=3.0, gt=0, description="maps later than this are spoken of in the status")
    ask_timeout_s: float = Field(default=2.0, gt=0, description="for one query")
    command_deadline_s: float = Field(default=60.0, gt=0, description="a robot that hears nothing for so long stops")
    max_steps: int = Field(default=5000, ge=1, description="the most that a mission may ask for")
    max_queued: int = Field(default=100, ge=0, description="so many missions may wait for a robot")
    finished_missions_kept: int = Field(default=1000, ge=1, description="the oldest are forgotten first")
