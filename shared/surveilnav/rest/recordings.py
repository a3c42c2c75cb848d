"""Recordings, the recorders that make them, and a recording that is replayed."""

from __future__ import annotations

from datetime import datetime

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.rest import examples
from surveilnav.rest.base import Resource, Text

#: A replay's speed; the same as in ``surveilnav.messages``.
SLOWEST_REPLAY, FASTEST_REPLAY = 0.01, 1000.0


class Recording(BaseModel):
    """The file that a mission was recorded to."""

    model_config = ConfigDict(json_schema_extra={"example": examples.RECORDING})

    id: str
    mission: str
    target: str
    state: str = Field(description="recording, complete, or interrupted: its end is missing, the rest can be read")
    n_bytes: int
    started: datetime | None
    changed: datetime | None = Field(description="when it was last written to")
    recorder: str
    cameras: list[str] | None = Field(description="whose pictures it shows; null: not known, as it isn't complete")
    file: str = Field(description="address of the file itself (MCAP), which answers requests for byte ranges")


class Recorder(Resource):
    """A process that records missions."""

    model_config = ConfigDict(json_schema_extra={"example": examples.RECORDER})

    id: str
    recording: list[str] = Field(description="ids of the recordings that are being written")
    problem: Text = Field(description="why something isn't recorded now; null while all is")
    dropped: int = Field(description="how many messages it dropped because its disk was too slow")
    n_bytes: int = Field(description="the size of all its recordings")
    free_bytes: int = Field(description="what is left on its disk")


class Replay(Resource):
    """A recording that is shown in the place of a building."""

    model_config = ConfigDict(json_schema_extra={"example": examples.REPLAY})

    mission: str
    target: str
    began: datetime | None = Field(description="when it happened")
    at_s: float = Field(description="the moment that is shown, in seconds from the beginning")
    duration_s: float
    speed: float = Field(description="how many times as fast as it happened")
    playing: bool
    jumps: int = Field(
        description="how often somebody went to another moment: what was told before may lie in its future"
    )


class ReplayChange(BaseModel):
    """What to change of a replay; what is left out stays as it is."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"example": {"at_s": 12.5, "playing": True}})

    at_s: float | None = Field(None, ge=0, le=1e9, allow_inf_nan=False, description="the moment to go on from")
    speed: float | None = Field(
        None, ge=SLOWEST_REPLAY, le=FASTEST_REPLAY, allow_inf_nan=False, description="how many times as fast"
    )
    playing: bool | None = Field(
        None, description="false: it stands still; true at its end without `at_s`: it begins anew"
    )
