"""Rebuilds fusion's maps from a recording, view by view, and answers queries for layers and objects meanwhile."""

from __future__ import annotations

from pathlib import Path

from surveilnav.bus import Node, Refused
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
    """Answers queries for layers, objects and pictures with fusion's own parts. ``folder``: where their log goes."""

    def __init__(self, node: Node, folder: Path) -> None:
        self._node, self._folder = node, folder
        self._texts = TextEncoder(Workers(node))
        self._positions = RobotPositions()
        self._log: MapLog | None = None
        self._answers: tuple[LayerAnswers, ObjectAnswers] | None = None
        self._n_begun = 0
        node.serve(MAP_LAYER, lambda request: self._ready()[0].layer(request), workers=3)
        node.serve(OBJECTS, lambda request: self._ready()[1].objects(request))
        node.serve(VIEW_PICTURE, lambda request: self._ready()[1].picture(request))

    def begin(self, maps: RecordedMaps) -> None:
        """Goes on from a snapshot; the maps of before are gone."""
        maps_of(maps)  # a snapshot that can't be read raises here, and the maps of before stay
        self.close()
        for old in self._folder.glob("maps-*"):
            old.unlink()
        self._n_begun += 1
        store = self._folder / f"maps-{self._n_begun}.sqlite"
        file = Store(store)
        file.save(maps.snapshot, maps.number)
        file.close()
        settings = _settings(config_of(maps), store)
        restored = BuildingMaps(settings.core())
        self._log = MapLog(self._node, settings, restored)
        self._positions = RobotPositions()
        reader = MapReader(restored, self._texts, self._positions)
        self._answers = LayerAnswers(self._node, reader), ObjectAnswers(reader, self._log)

    def integrate(self, view: LoggedView, payload: bytes) -> None:
        if self._log is not None:
            perceived = perceived_from_entry(entry_of(view, payload))
            self._positions.record(perceived.header)
            self._log.integrate([perceived])

    def forget(self) -> None:
        """Answers nothing until it begins again: a replay that was taken back must not show maps of its future."""
        self._answers = None

    def close(self) -> None:
        if self._log is not None:
            self._log.close()

    def _ready(self) -> tuple[LayerAnswers, ObjectAnswers]:
        if self._answers is None:
            raise Refused("not_recorded", "the recording tells nothing of the maps (yet)")
        return self._answers


def _settings(config: FusionConfig, store: Path) -> FusionSettings:
    """Fusion's settings with which it has that configuration."""
    parts = {name: getattr(config, name).model_dump() for name in type(config).model_fields}
    return FusionSettings(store=str(store), **parts)
