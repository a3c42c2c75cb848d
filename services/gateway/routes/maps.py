"""``/floors``, and their layers as pictures."""

from __future__ import annotations

from dataclasses import astuple
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Response

from services.gateway.core.layers import Picture
from services.gateway.core.resources import ROOT, Floor, Items
from services.gateway.maps import Maps
from services.gateway.routes.paging import Id, Limit, Offset, page_of

_PNG: dict[int | str, dict[str, Any]] = {200: {"content": {"image/png": {}}, "description": "the picture"}}


def router(found: Maps) -> APIRouter:
    """Floors, pictures of their layers."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/floors")
    def floors(limit: Limit = 100, offset: Offset = 0) -> Items[Floor]:
        return page_of(found.floors(), limit, offset)

    @router.get("/floors/{id}/layers/{layer}.png", response_class=Response, responses=_PNG)
    def layer(
        id: Id, layer: Annotated[str, Path(max_length=64)], target: Annotated[str, Query(max_length=200)] = ""
    ) -> Response:
        """A map layer, north up, one pixel a cell: occupancy (slate), explored (pale blue), frontier (orange), or
        value (viridis from the lowest to the highest value, for ``target``; default: the newest mission's). All
        else is transparent. ``X-Surveilnav-Grid`` holds the world position of the lower left corner, the cell
        size [m], rows and columns; ``X-Surveilnav-Range`` the ends of the value scale;
        ``X-Surveilnav-Views-Left-Out`` how many views another model looked at, if any.
        """
        picture, revision = found.layer(id, layer, target.strip())
        return Response(picture.png, media_type="image/png", headers=_headers(picture, revision))

    return router


def _headers(picture: Picture, revision: int) -> dict[str, str]:
    headers = {
        "Cache-Control": "no-cache",
        "X-Surveilnav-Revision": str(revision),
        "X-Surveilnav-Grid": " ".join(f"{v:g}" for v in astuple(picture.grid)),
    }
    if picture.views_left_out:
        headers["X-Surveilnav-Views-Left-Out"] = str(picture.views_left_out)
    if picture.low is not None and picture.high is not None:
        headers["X-Surveilnav-Range"] = f"{picture.low:.6g} {picture.high:.6g}"
    return headers
