"""The building that this gateway stands for."""

from __future__ import annotations

from collections.abc import Sequence

from pydantic import Field

from surveilnav.messages import FINISHED_STATES
from surveilnav.services.gateway.core.resources.base import Resource
from surveilnav.services.gateway.core.resources.camera import Camera
from surveilnav.services.gateway.core.resources.floor import Floor
from surveilnav.services.gateway.core.resources.mission import Mission
from surveilnav.services.gateway.core.resources.robot import Robot


class Building(Resource):
    id: str = Field(description="its name in every key on the bus")
    floors: list[str]
    cameras: int = Field(description="that announced themselves")
    robots: int = Field(description="that were heard of")
    missions: int = Field(description="under way")
    ready: bool = Field(description="a mission could run now; /readyz says what is missing")

    @classmethod
    def of(
        cls,
        id: str,
        floors: Sequence[Floor],
        cameras: Sequence[Camera],
        robots: Sequence[Robot],
        missions: Sequence[Mission],
        *,
        ready: bool,
    ) -> Building:
        """A building by what is in it; stale if all of that is."""
        inside: list[Resource] = [*floors, *cameras, *robots]
        times = [r.last_seen.timestamp() for r in inside if r.last_seen]
        return cls(
            id=id,
            floors=[f.id for f in floors],
            cameras=len(cameras),
            robots=len(robots),
            missions=sum(m.state not in FINISHED_STATES for m in missions),
            ready=ready,
            last_seen=int(max(times, default=0.0) * 1e9),
            stale=all(r.stale for r in inside),
        )
