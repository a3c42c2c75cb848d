"""The joint map: floors, and pictures of layers."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

from surveilnav import contract
from surveilnav.errors import WireError
from surveilnav.sensing.layers import unpack_cloud, unpack_layer
from surveilnav.services.gateway.asking import ask_known
from surveilnav.services.gateway.cameras import Cameras
from surveilnav.services.gateway.core import layers
from surveilnav.services.gateway.core.clouds import thinned
from surveilnav.services.gateway.core.layers import Drawn
from surveilnav.services.gateway.core.problems import Problem
from surveilnav.services.gateway.core.resources import Floor, Layer
from surveilnav.services.gateway.missions import Missions
from surveilnav.services.gateway.single_flight import SingleFlight
from surveilnav.services.gateway.sources import Sources
from surveilnav.services.gateway.state import BuildingState

#: So long one picture of a layer serves all who look: its maps change with every step of a robot.
_LAYER_S = 0.5
_MOST_LAYERS = 64
_CLOUD_S = 10.0
Form = Literal["png", "npy"]


class _Key(NamedTuple):
    """What a picture or array shows."""

    floor: str
    layer: str
    form: Form
    target: str


class Maps:
    """What fusion holds of the building, floor by floor."""

    def __init__(self, state: BuildingState, cameras: Cameras, sources: Sources, missions: Missions) -> None:
        self._state, self._node = state, state.node
        self._cameras, self._sources, self._missions = cameras, sources, missions
        self._layers: SingleFlight[tuple[Drawn, int]] = SingleFlight(_LAYER_S, _MOST_LAYERS)
        self._clouds: SingleFlight[bytes] = SingleFlight(_CLOUD_S, most=4)

    def clear(self) -> None:
        """Begins anew: a replay was taken to another moment."""
        self._layers.clear()
        self._clouds.clear()

    def floors(self) -> list[Floor]:
        """Every floor that has a map, a camera or a robot."""
        revisions = self._state.revisions.newest("floor")
        cameras, robots = self._cameras.all(), self._sources.robots()
        names = set(revisions) | {c.floor for c in cameras} | {r.floor for r in robots}
        return [
            Floor.from_revision(
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
        return Layer.of(floor, layer, target, *self.layer(floor, layer, target, "npy"), self._state.root)

    def layer(self, floor: str, layer: str, target: str, form: Form = "png") -> tuple[Drawn, int]:
        """A layer as a picture or an array, at most half a second old, and the revision that it shows."""
        if layer not in layers.COLOURS:
            raise Problem(404, "unknown_layer", f"no picture of {layer!r}; layers: {', '.join(layers.COLOURS)}")
        target = (target or self._searched(floor)) if layer == "value" else ""
        key = _Key(floor, layer, form, target)
        return self._layers.get(key, lambda: self._drawn(key))

    def cloud(self, floor: str, most: int) -> bytes:
        """The joint cloud as numpy's .npy, float32 (N, 6), at most so many points, at most ten seconds old: fusion sends all
        that it has, which is much, once for all who ask."""
        return self._clouds.get((floor, most), lambda: self._thinned(floor, most))

    def _thinned(self, floor: str, most: int) -> bytes:
        row = ask_known(self._node, "floor", floor, "fusion", contract.MAP_LAYER, floor=floor, layer="cloud")
        try:
            return layers.npy(thinned(unpack_cloud(row.message, row.payload), most))
        except WireError as error:
            raise Problem(502, "bad_layer", f"fusion sent a cloud that can't be read: {error}") from error

    def _searched(self, floor: str) -> str:
        """The target of the newest mission, preferably one on this floor: whose values a person wants to see."""
        missions = sorted(self._missions.all(), key=lambda m: m.floor != floor)
        if not missions:
            raise Problem(422, "no_target", "the value layer belongs to a target: add ?target=..., or submit a mission")
        return missions[0].target

    def _drawn(self, key: _Key) -> tuple[Drawn, int]:
        floor, layer, form, target = key
        parameters = {"target": target} if target else None
        row = ask_known(
            self._node, "floor", floor, "fusion", contract.MAP_LAYER, parameters=parameters, floor=floor, layer=layer
        )
        try:
            cells = unpack_layer(layer, row.message, row.payload)
        except WireError as error:
            raise Problem(502, "bad_layer", f"fusion sent a {layer} layer that can't be read: {error}") from error
        drawn = (layers.render if form == "png" else layers.as_array)(layer, row.message.grid, cells)
        return replace(drawn, views_left_out=row.message.views_left_out), row.message.revision
