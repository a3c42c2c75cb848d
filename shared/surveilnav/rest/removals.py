"""Taking what a camera or a robot has contributed out of the maps again."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from pydantic import AwareDatetime, BaseModel, ConfigDict, Field, model_validator


class NewRemoval(BaseModel):
    """What is to be taken out of the maps."""

    model_config = ConfigDict(extra="forbid")

    source: str = Field(
        pattern=r"^(camera|robot)/[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$", description="camera/ID or robot/ID"
    )
    since: AwareDatetime | None = Field(
        default=None, description="only what was seen from this time on, with its time zone"
    )
    until: AwareDatetime | None = Field(default=None, description="only what was seen up to this time")

    @model_validator(mode="after")
    def _ends_after_its_beginning(self) -> NewRemoval:
        if self.since is not None and self.until is not None and self.since > self.until:
            raise ValueError("expected since before until")
        return self


class Removal(BaseModel):
    """A camera's or a robot's contribution that was taken out of the maps, or is being so."""

    id: str
    source: str
    since: datetime | None = Field(description="null: from the beginning")
    until: datetime | None = Field(description="null: up to the request")
    way: Literal["replay", "provenance"] = Field(
        description="replay: the maps are computed again and equal those that never had it; provenance: the log doesn't "
        "reach back far enough, so what the source alone has seen is taken out"
    )
    state: Literal["running", "done", "failed"]
    views_done: int = Field(description="while it runs: how many logged views were processed again ...")
    views_total: int = Field(description="... of how many")
    message: str = Field(description="what was done, what remains, or why it failed")
    requested: datetime | None
    finished: datetime | None
