"""Rebuilds fusion's maps from a recording, view by view, and answers queries for layers and objects meanwhile."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from surveilnav.bus import Answer, Node, Refused, Request
from surveilnav.cli.replay.check import config_of, entry_of, maps_of
from surveilnav.contract import MAP_LAYER, OBJECTS, VIEW_PICTURE
from surveilnav.messages import LoggedView
from surveilnav.services.fusion.answers.layers import LayerAnswers
from surveilnav.services.fusion.answers.objects import ObjectAnswers
from surveilnav.services.fusion.answers.reader import MapReader
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.fusion.intake.robot_positions import RobotPositions
from surveilnav.services.fusion.intake.texts import TextEncoder
from surveilnav.services.fusion.intake.workers import Workers
from surveilnav.services.fusion.map_log.log import MapLog
from surveilnav.services.fusion.map_log.recovery import perceived_from_entry
from surveilnav.services.fusion.map_log.store import Store
from surveilnav.services.recorder.recorded import RecordedMaps


class ReplayedMaps:
    """Answers queries for layers, objects and pictures with fusion's own parts. ``folder``: where their log goes.

    A recording of a building with several fusion services holds the maps of each, of different floors.
    """

    def __init__(self, node: Node, folder: Path) -> None:
        self._node, self._folder = node, folder
        self._texts = TextEncoder(Workers(node))
        self._parts: dict[str, _Part] = {}  # by fusion service
        self._n_begun = 0
        node.serve(MAP_LAYER, lambda request: self._part_with(request).layers.layer(request), workers=3)
        node.serve(OBJECTS, self._objects)
        node.serve(VIEW_PICTURE, lambda request: self._part_with(request).objects.picture(request))

    def begin(self, maps: RecordedMaps) -> None:
        """Goes on from a snapshot; the maps of before are gone, but for those of other fusion services."""
        maps_of(maps)  # a snapshot that can't be read raises here, and the maps of before stay
        if former := self._parts.pop(maps.fusion, None):
            former.log.close()
        if not self._parts:
            for old in self._folder.glob("maps-*"):
                old.unlink()
        self._n_begun += 1
        store = self._folder / f"maps-{self._n_begun}.sqlite"
        file = Store(store)
        file.save(maps.snapshot, maps.number)
        file.close()
        settings = _settings(config_of(maps), store)
        restored = BuildingMaps(settings.core())
        log, positions = MapLog(self._node, settings, restored), RobotPositions()
        reader = MapReader(restored, self._texts, positions)
        layers, objects = LayerAnswers(self._node, reader), ObjectAnswers(reader, log)
        self._parts[maps.fusion] = _Part(log, restored, positions, layers, objects)

    def integrate(self, view: LoggedView, payload: bytes) -> None:
        if part := self._parts.get(view.fusion):
            perceived = perceived_from_entry(entry_of(view, payload))
            part.positions.record(perceived.header)
            part.log.integrate([perceived])

    def forget(self) -> None:
        """Answers nothing until it begins again: a replay that was taken back must not show maps of its future."""
        self.close()

    def close(self) -> None:
        for part in self._parts.values():
            part.log.close()
        self._parts = {}

    def _objects(self, request: Request) -> list[Answer]:
        if request.ids.get("floor") is not None:
            return self._part_with(request).objects.objects(request)
        return [answer for part in self._ready() for answer in part.objects.objects(request)]

    def _part_with(self, request: Request) -> _Part:
        """The part that has the floor of a query; any if none has it."""
        floor, parts = request.ids.get("floor"), self._ready()
        return next((part for part in parts if floor in part.maps.joint.floors), parts[0])

    def _ready(self) -> list[_Part]:
        parts = list(self._parts.values())
        if not parts:
            raise Refused("not_recorded", "the recording tells nothing of the maps (yet)")
        return parts


@dataclass(frozen=True, slots=True)
class _Part:
    """The maps of one fusion service."""

    log: MapLog
    maps: BuildingMaps
    positions: RobotPositions
    layers: LayerAnswers
    objects: ObjectAnswers


def _settings(config: FusionConfig, store: Path) -> FusionSettings:
    """Fusion's settings with which it has that configuration."""
    parts = {name: getattr(config, name).model_dump() for name in type(config).model_fields}
    return FusionSettings(store=str(store), **parts)
