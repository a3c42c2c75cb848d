"""The maps of each floor: layers as pictures and arrays, and the point cloud; the routes ``/floors``."""

from __future__ import annotations

from dataclasses import astuple, replace
from typing import Annotated, Literal, NamedTuple

from fastapi import APIRouter, Path, Query, Response

from surveilnav import contract
from surveilnav.errors import WireError
from surveilnav.rest import ROOT, Floor, Items, Layer
from surveilnav.sensing.layers import unpack_cloud, unpack_layer
from surveilnav.services.gateway.answer_cache import AnswerCache
from surveilnav.services.gateway.bus_requests import request_existing
from surveilnav.services.gateway.cameras import Cameras
from surveilnav.services.gateway.core import layers
from surveilnav.services.gateway.core.layers import RenderedLayer
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import floor_from_revision, layer_from_array
from surveilnav.services.gateway.missions import Missions
from surveilnav.services.gateway.responses import (
    NOT_CHANGED,
    Id,
    IfNoneMatch,
    Limit,
    Offset,
    Responses,
    etag_response,
    page_of,
)
from surveilnav.services.gateway.robots import Robots
from surveilnav.services.gateway.state import BuildingState

#: Within this time, all clients get the same picture of a layer. The maps change with every step of a robot.
_LAYER_AGE_S = 0.5
_MAX_LAYERS = 64
_CLOUD_AGE_S = 10.0
_MAX_CLOUDS = 4
Form = Literal["png", "npy"]
_PNG: Responses = {200: {"content": {"image/png": {}}, "description": "the picture"}, **NOT_CHANGED}
_NPY: Responses = {200: {"content": {"application/octet-stream": {}}, "description": "the array"}, **NOT_CHANGED}
_LayerName = Annotated[str, Path(max_length=64)]
_Target = Annotated[str, Query(max_length=200)]


class _LayerKey(NamedTuple):
    """What identifies a rendered layer. ``target``: only for the value layer."""

    floor: str
    layer: str
    form: Form
    target: str


class Maps:
    """The floors of the building and their maps, requested from fusion and cached for a short time."""

    def __init__(self, state: BuildingState, cameras: Cameras, robots: Robots, missions: Missions) -> None:
        self._state, self._node = state, state.node
        self._cameras, self._robots, self._missions = cameras, robots, missions
        self._layers: AnswerCache[tuple[RenderedLayer, int]] = AnswerCache(_LAYER_AGE_S, _MAX_LAYERS)
        self._clouds: AnswerCache[bytes] = AnswerCache(_CLOUD_AGE_S, _MAX_CLOUDS)

    def clear(self) -> None:
        """Empties the caches, because a replay jumped to another moment."""
        self._layers.clear()
        self._clouds.clear()

    def floors(self) -> list[Floor]:
        """Every floor that has a map, a camera or a robot."""
        revisions = self._state.revisions.newest("floor")
        cameras, robots = self._cameras.all(), self._robots.all()
        names = set(revisions) | {c.floor for c in cameras} | {r.floor for r in robots}
        return [
            floor_from_revision(
                name,
                revisions[name].message if name in revisions else None,
                [r.id for r in robots if r.floor == name],
                [c.id for c in cameras if c.floor == name],
                revisions[name].received_ns if name in revisions else None,
                self._state.alive("fusion"),
                self._state.root,
            )
            for name in sorted(names)
        ]

    def place(self, floor: str, layer: str, target: str) -> Layer:
        """Where a layer lies in the world."""
        return layer_from_array(floor, layer, target, *self.layer(floor, layer, target, "npy"), self._state.root)

    def layer(self, floor: str, layer: str, target: str, form: Form = "png") -> tuple[RenderedLayer, int]:
        """A layer as a picture or an array, at most half a second old, and the revision that it shows."""
        if layer not in layers.COLOURS:
            raise Problem(404, "unknown_layer", f"no picture of {layer!r}; layers: {', '.join(layers.COLOURS)}")
        target = (target or self._searched_target(floor)) if layer == "value" else ""
        key = _LayerKey(floor, layer, form, target)
        return self._layers.get(key, lambda: self._rendered(key))

    def cloud(self, floor: str, max_points: int) -> bytes:
        """The joint cloud as numpy's .npy: float32 (N, 6), at most ``max_points`` points, at most ten seconds old.

        It is cached for all clients, because fusion always sends the whole cloud, which is large.
        """
        return self._clouds.get((floor, max_points), lambda: self._thinned_cloud(floor, max_points))

    def _thinned_cloud(self, floor: str, max_points: int) -> bytes:
        row = request_existing(self._node, "floor", floor, "fusion", contract.MAP_LAYER, floor=floor, layer="cloud")
        try:
            return layers.npy(layers.thinned_cloud(unpack_cloud(row.message, row.payload), max_points))
        except WireError as error:
            raise Problem(502, "bad_layer", f"fusion sent a cloud that can't be read: {error}") from error

    def _searched_target(self, floor: str) -> str:
        """The target of the newest mission, preferably of one on this floor: most likely, its values are of interest."""
        missions = sorted(self._missions.all(), key=lambda mission: mission.floor != floor)
        if not missions:
            raise Problem(422, "no_target", "the value layer belongs to a target: add ?target=..., or submit a mission")
        return missions[0].target

    def _rendered(self, key: _LayerKey) -> tuple[RenderedLayer, int]:
        floor, layer, form, target = key
        parameters = {"target": target} if target else None
        row = request_existing(
            self._node, "floor", floor, "fusion", contract.MAP_LAYER, parameters=parameters, floor=floor, layer=layer
        )
        try:
            cells = unpack_layer(layer, row.message, row.payload)
        except WireError as error:
            raise Problem(502, "bad_layer", f"fusion sent a {layer} layer that can't be read: {error}") from error
        rendered = (layers.render if form == "png" else layers.as_array)(layer, row.message.grid, cells)
        return replace(rendered, views_left_out=row.message.views_left_out), row.message.revision


def router(maps: Maps) -> APIRouter:
    router = APIRouter(prefix=ROOT, tags=["building"])

    @router.get("/floors", name="floors")
    def list_floors(limit: Limit = 100, offset: Offset = 0) -> Items[Floor]:
        return page_of(maps.floors(), limit, offset)

    @router.get("/floors/{id}/layers/{layer}.png", response_class=Response, responses=_PNG)
    def picture(id: Id, layer: _LayerName, target: _Target = "", if_none_match: IfNoneMatch = "") -> Response:
        """A map layer, at most half a second old, north up, one pixel per cell: occupancy (slate), explored (pale blue),
        frontier (orange), or value (viridis from the lowest to the highest value, for ``target``; default: the newest
        mission's). All else is transparent. ``X-Surveilnav-Grid`` holds the world position of the lower left corner, the
        cell size [m], rows and columns. ``X-Surveilnav-Range`` holds the lowest and the highest value, and
        ``X-Surveilnav-Views-Left-Out`` the number of views that are left out because another model embedded them, if any.
        """
        rendered, revision = maps.layer(id, layer, target.strip())
        return etag_response(rendered.data, "image/png", _headers(rendered, revision), if_none_match)

    @router.get("/floors/{id}/layers/{layer}.npy", response_class=Response, responses=_NPY)
    def array(id: Id, layer: _LayerName, target: _Target = "", if_none_match: IfNoneMatch = "") -> Response:
        """A map layer as numpy's .npy, with the headers of its picture. Row 0 is the southernmost. uint8 0 or 1; for
        value float32, NaN where unknown."""
        rendered, revision = maps.layer(id, layer, target.strip(), "npy")
        return etag_response(rendered.data, "application/octet-stream", _headers(rendered, revision), if_none_match)

    @router.get("/floors/{id}/layers/{layer}")
    def layer(id: Id, layer: Annotated[str, Path(pattern="^[a-z]{1,64}$")], target: _Target = "") -> Layer:
        """Where a map layer lies in the world, and where its picture and its array are."""
        return maps.place(id, layer, target.strip())

    @router.get("/floors/{id}/cloud.npy", response_class=Response, responses=_NPY)
    def cloud(
        id: Id, points: Annotated[int, Query(ge=1, le=200_000)] = 50_000, if_none_match: IfNoneMatch = ""
    ) -> Response:
        """The joint cloud, as numpy's .npy: float32 (N, 6), x, y, z [m, world] and red, green, blue [0-1]. At most ``points``
        of its points, spread evenly, at most ten seconds old."""
        return etag_response(maps.cloud(id, points), "application/octet-stream", {}, if_none_match)

    return router


def _headers(rendered: RenderedLayer, revision: int) -> dict[str, str]:
    headers = {
        "X-Surveilnav-Revision": str(revision),
        "X-Surveilnav-Grid": " ".join(f"{v:g}" for v in astuple(rendered.grid)),
    }
    if rendered.views_left_out:
        headers["X-Surveilnav-Views-Left-Out"] = str(rendered.views_left_out)
    if rendered.low is not None and rendered.high is not None:
        headers["X-Surveilnav-Range"] = f"{rendered.low:.6g} {rendered.high:.6g}"
    return headers
