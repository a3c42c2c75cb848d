"""``/floors``, and their layers as pictures and arrays."""

from __future__ import annotations

from dataclasses import astuple
from typing import Annotated, Any

from fastapi import APIRouter, Path, Query, Response

from surveilnav.services.gateway.core.layers import Drawn
from surveilnav.services.gateway.core.resources import ROOT, Floor, Items, Layer
from surveilnav.services.gateway.maps import Maps
from surveilnav.services.gateway.routes.conditional import NOT_CHANGED, IfNoneMatch, answer
from surveilnav.services.gateway.routes.paging import Id, Limit, Offset, page_of

_PNG: dict[int | str, dict[str, Any]] = {
    200: {"content": {"image/png": {}}, "description": "the picture"},
    **NOT_CHANGED,
}
_NPY: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/octet-stream": {}}, "description": "the array"},
    **NOT_CHANGED,
}
LayerName = Annotated[str, Path(max_length=64)]
Target = Annotated[str, Query(max_length=200)]


def router(found: Maps) -> APIRouter:
    """Floors and their layers."""
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/floors")
    def floors(limit: Limit = 100, offset: Offset = 0) -> Items[Floor]:
        return page_of(found.floors(), limit, offset)

    @router.get("/floors/{id}/layers/{layer}.png", response_class=Response, responses=_PNG)
    def picture(id: Id, layer: LayerName, target: Target = "", if_none_match: IfNoneMatch = "") -> Response:
        """A map layer, at most half a second old, north up, one pixel a cell: occupancy (slate), explored (pale blue),
        frontier (orange), or value (viridis from the lowest to the highest value, for ``target``; default: the newest
        mission's). All else is transparent. ``X-Surveilnav-Grid`` holds the world position of the lower left corner, the
        cell size [m], rows and columns; ``X-Surveilnav-Range`` the ends of the value scale;
        ``X-Surveilnav-Views-Left-Out`` how many views another model looked at, if any.
        """
        drawn, revision = found.layer(id, layer, target.strip())
        return answer(drawn.data, "image/png", _headers(drawn, revision), if_none_match)

    @router.get("/floors/{id}/layers/{layer}.npy", response_class=Response, responses=_NPY)
    def array(id: Id, layer: LayerName, target: Target = "", if_none_match: IfNoneMatch = "") -> Response:
        """A map layer as numpy's .npy, with the headers of its picture. Row 0 is the southernmost. uint8 0 or 1; for
        value float32, NaN where unknown."""
        drawn, revision = found.layer(id, layer, target.strip(), "npy")
        return answer(drawn.data, "application/octet-stream", _headers(drawn, revision), if_none_match)

    @router.get("/floors/{id}/layers/{layer}")
    def layer(id: Id, layer: Annotated[str, Path(pattern="^[a-z]{1,64}$")], target: Target = "") -> Layer:
        """Where a map layer lies in the world, and where its picture and its array are."""
        return found.place(id, layer, target.strip())

    @router.get("/floors/{id}/cloud.npy", response_class=Response, responses=_NPY)
    def cloud(
        id: Id, points: Annotated[int, Query(ge=1, le=200_000)] = 50_000, if_none_match: IfNoneMatch = ""
    ) -> Response:
        """The joint cloud, as numpy's .npy: float32 (N, 6), x, y, z [m, world] and red, green, blue [0-1]. At most ``points``
        of its points, spread evenly, at most ten seconds old."""
        return answer(found.cloud(id, points), "application/octet-stream", {}, if_none_match)

    return router


def _headers(drawn: Drawn, revision: int) -> dict[str, str]:
    headers = {
        "X-Surveilnav-Revision": str(revision),
        "X-Surveilnav-Grid": " ".join(f"{v:g}" for v in astuple(drawn.grid)),
    }
    if drawn.views_left_out:
        headers["X-Surveilnav-Views-Left-Out"] = str(drawn.views_left_out)
    if drawn.low is not None and drawn.high is not None:
        headers["X-Surveilnav-Range"] = f"{drawn.low:.6g} {drawn.high:.6g}"
    return headers
