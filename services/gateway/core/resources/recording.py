"""Recordings, who makes them, and one that is shown again."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from surveilnav.messages import FASTEST_REPLAY, SLOWEST_REPLAY, RecorderStatus, ReplayStatus
from surveilnav.messages import Recording as Kept
from surveilnav.services.gateway.core.resources import examples
from surveilnav.services.gateway.core.resources.base import ROOT, Resource, Text, Time


class Recording(BaseModel):
    """A mission's file."""

    model_config = ConfigDict(json_schema_extra={"example": examples.RECORDING})

    id: str
    mission: str
    target: str
    state: str = Field(description="recording, complete, or interrupted: its end is missing, it can be read so far")
    n_bytes: int
    started: Time
    changed: Time = Field(description="when something was last written to it")
    recorder: str
    cameras: list[str] | None = Field(description="whose pictures it shows; null: not known, as it isn't complete")
    file: str = Field(description="address of the file itself, MCAP; ranges of it can be had")

    @classmethod
    def of(cls, kept: Kept, recorder: str, root: str = ROOT) -> Recording:
        """A file that a recorder tells of."""
        return cls(
            id=kept.id,
            mission=kept.mission,
            target=kept.target,
            state=kept.state,
            n_bytes=kept.n_bytes,
            started=kept.started_ns,
            changed=kept.changed_ns,
            recorder=recorder,
            cameras=kept.cameras,
            file=f"{root}/recordings/{kept.id}/file",
        )  # type: ignore[arg-type]


class Recorder(Resource):
    """Who makes recordings."""

    model_config = ConfigDict(json_schema_extra={"example": examples.RECORDER})

    id: str = Field(validation_alias="recorder")
    recording: list[str] = Field(description="ids of the recordings that are being written")
    problem: Text = Field(description="why something isn't recorded now; null while all is")
    dropped: int = Field(description="messages that its disk was too slow for")
    n_bytes: int = Field(description="of all its recordings")
    free_bytes: int = Field(description="left on its disk")

    @classmethod
    def from_status(cls, status: RecorderStatus, seen_ns: int, stale: bool) -> Recorder:
        """A recorder as it tells of itself."""
        return cls.made_of(status, last_seen=seen_ns, stale=stale)


class Replay(Resource):
    """A recording that is shown again in the place of a building."""

    model_config = ConfigDict(json_schema_extra={"example": examples.REPLAY})

    mission: str
    target: str
    began: Time = Field(description="when it happened")
    at_s: float = Field(description="the moment that is shown, from its beginning on")
    duration_s: float
    speed: float = Field(description="so many times as fast as it happened")
    playing: bool
    jumps: int = Field(
        description="how often it was taken to another moment: what was told before may lie in its future"
    )

    @classmethod
    def from_status(cls, status: ReplayStatus, seen_ns: int, stale: bool) -> Replay:
        """A replay as it tells of itself."""
        return cls.made_of(status, began=status.began_ns, last_seen=seen_ns, stale=stale)


class ReplayChange(BaseModel):
    """What a replay should do; what is left out stays as it is."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"example": {"at_s": 12.5, "playing": True}})

    at_s: float | None = Field(None, ge=0, le=1e9, allow_inf_nan=False, description="the moment to go on from")
    speed: float | None = Field(
        None, ge=SLOWEST_REPLAY, le=FASTEST_REPLAY, allow_inf_nan=False, description="so many times as fast"
    )
    playing: bool | None = Field(
        None, description="false: it stands still; true while it is at its end, and no at_s: it begins anew"
    )
