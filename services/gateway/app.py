"""The web side. Endpoints are plain functions, so FastAPI runs them on threads."""

from __future__ import annotations

from fastapi import FastAPI

from surveilnav import __version__
from surveilnav.services.gateway import problem_answers, refusals
from surveilnav.services.gateway.routes import (
    cameras,
    documentation,
    events,
    live,
    maps,
    missions,
    objects,
    page,
    pictures,
    recordings,
    replay,
    sources,
    system,
)
from surveilnav.services.gateway.service import Gateway


def create_app(gateway: Gateway, allowed_hosts: frozenset[str] | None) -> FastAPI:
    """The application around ``gateway``, which answers under those names (None: under any).

    It serves until its owner closes the node.
    """
    # FastAPI's own documentation pages load their scripts from elsewhere.
    app = FastAPI(
        title="SurveilNav",
        version=__version__,
        description="Surveillance cameras and a robot search a building together.",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,  # an address has one spelling
        responses=problem_answers.RESPONSES,
    )
    app.add_middleware(refusals.Refusals, problem=refusals.check(allowed_hosts))
    problem_answers.answer_failures(app)
    app.include_router(missions.router(gateway.missions, gateway.costs))
    app.include_router(cameras.router(gateway.cameras, gateway.looks))
    app.include_router(pictures.router(gateway.pictures))
    app.include_router(sources.router(gateway.sources))
    app.include_router(maps.router(gateway.maps))
    app.include_router(objects.router(gateway.objects, gateway.looks))
    app.include_router(recordings.router(gateway.recordings, gateway.looks))
    app.include_router(replay.router(gateway.replays))
    app.include_router(events.router(gateway.events))
    app.include_router(live.router(gateway.live, gateway.tiles, gateway.looks))
    app.include_router(system.router(gateway))
    app.include_router(page.router())
    app.include_router(documentation.router())
    return app
