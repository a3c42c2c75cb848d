"""The web application. Endpoints are plain functions, so FastAPI runs them on threads."""

from __future__ import annotations

from fastapi import FastAPI

from surveilnav import __version__
from surveilnav.services.gateway import (
    areas,
    cameras,
    maps,
    missions,
    objects,
    pages,
    recordings,
    removals,
    robots,
    session,
    sightings,
    streams,
    system,
)
from surveilnav.services.gateway.access_checks import AccessChecks
from surveilnav.services.gateway.authentication import Authentication
from surveilnav.services.gateway.core.hosts import Networks
from surveilnav.services.gateway.request_checks import RequestChecks
from surveilnav.services.gateway.request_ids import RequestIds
from surveilnav.services.gateway.responses import PROBLEMS, add_problem_handlers
from surveilnav.services.gateway.service import Gateway


def create_app(
    gateway: Gateway,
    allowed_hosts: frozenset[str] | None,
    authentication: Authentication | None = None,
    trusted_proxies: Networks = (),
) -> FastAPI:
    """The web application for ``gateway``.

    Args:
        allowed_hosts: the hosts as which it is asked; None: any.
        authentication: knows the keys with which it is asked; None: it answers without.
        trusted_proxies: proxies whose ``X-Forwarded-For`` is believed.
    """
    # FastAPI's own documentation pages load scripts from other servers, so `pages` has ours.
    app = FastAPI(
        title="SurveilNav",
        version=__version__,
        description="Surveillance cameras and a robot search a building together.",
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,  # an address has one spelling
        responses=PROBLEMS,
    )
    app.add_middleware(AccessChecks, authentication=authentication, trusted_proxies=trusted_proxies)
    app.add_middleware(RequestChecks, allowed=allowed_hosts)
    app.add_middleware(RequestIds)  # comes first
    add_problem_handlers(app)
    app.include_router(missions.router(gateway.missions, gateway.meter))
    app.include_router(cameras.router(gateway.cameras, gateway.pictures, gateway.access_log))
    app.include_router(robots.router(gateway.robots, gateway.workers))
    app.include_router(maps.router(gateway.maps))
    app.include_router(areas.router(gateway.areas))
    app.include_router(objects.router(gateway.objects, gateway.access_log))
    app.include_router(removals.router(gateway.removals))
    app.include_router(sightings.router(gateway.sightings))
    app.include_router(recordings.router(gateway.recordings, gateway.replays, gateway.access_log))
    app.include_router(streams.router(gateway.events, gateway.live, gateway.tiles, gateway.access_log))
    app.include_router(session.router(authentication, trusted_proxies))
    app.include_router(system.router(gateway))
    app.include_router(pages.router())
    return app
