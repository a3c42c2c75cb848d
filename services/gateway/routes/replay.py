"""``/replay``."""

from __future__ import annotations

from fastapi import APIRouter

from surveilnav.services.gateway.core.resources import ROOT, Replay, ReplayChange
from surveilnav.services.gateway.replays import Replays


def router(found: Replays) -> APIRouter:
    """The recording that is shown, where one is."""
    router = APIRouter(prefix=ROOT, tags=["recordings"])

    @router.get("/replay")
    def replay() -> Replay:
        """Where the recording is that `surveilnav replay` shows here; 404 `no_replay` on the gateway of a building."""
        return found.one()

    @router.patch("/replay")
    def change(wanted: ReplayChange) -> Replay:
        """Has it play, stand still, go to a moment (`at_s`, also back), or change its speed. Going far takes seconds: all that
        happened before is made again."""
        return found.change(wanted)

    return router
