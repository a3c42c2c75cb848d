"""Rebuilds fusion's maps from a recording, view by view, and answers queries for layers and objects meanwhile."""

from __future__ import annotations

from pathlib import Path

from surveilnav.bus import Node, Refused
from surveilnav.cli.replay.check import config_of, entry_of, maps_of
from surveilnav.contract import MAP_LAYER, OBJECTS, VIEW_PICTURE
from surveilnav.messages import LoggedView
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.fusion.durable_map import DurableMap
from surveilnav.services.fusion.journal import perceived_of
from surveilnav.services.fusion.perception_client import PerceptionClient
from surveilnav.services.fusion.replies import Replies
from surveilnav.services.fusion.robot_places import RobotPlaces
from surveilnav.services.fusion.store import Store
from surveilnav.services.recorder.recorded import Maps


class ReplayedMaps:
    """The maps of a replay, served by fusion's own components. ``folder``: where their log goes."""

    def __init__(self, node: Node, folder: Path) -> None:
        self._node, self._folder = node, folder
        self._maps: DurableMap | None = None
        self._replies: Replies | None = None
        self._known: PerceptionClient | None = None
        self._places = RobotPlaces()
        self._begun = 0
        node.serve(MAP_LAYER, lambda request: self._ready().layer(request), workers=3)
        node.serve(OBJECTS, lambda request: self._ready().objects(request))
        node.serve(VIEW_PICTURE, lambda request: self._ready().picture(request))

    def begin(self, maps: Maps) -> None:
        """Starts from a snapshot and drops the maps so far."""
        maps_of(maps)  # what can't be read is said, and nothing is begun anew in its place
        self.close()
        for old in self._folder.glob("maps-*"):
            old.unlink()
        self._begun += 1
        store = self._folder / f"maps-{self._begun}.sqlite"
        file = Store(store)
        file.save(maps.snapshot, maps.number)
        file.close()
        settings = _settings(config_of(maps), store)
        self._maps = DurableMap(self._node, settings)
        if self._known is None:  # its threads stay; it is asked for the meaning of words alone
            self._known = PerceptionClient(
                self._node, settings, lambda *_: True, tuple, lambda waiting: next(iter(waiting))
            )
        self._places = RobotPlaces()
        self._replies = Replies(self._node, settings.core(), self._maps, self._known, self._places)

    def take(self, view: LoggedView, payload: bytes) -> None:
        """Integrates a view."""
        if self._maps is not None:
            perceived = perceived_of(entry_of(view, payload))
            self._places.note(perceived.header)
            self._maps.take([perceived])

    def forget(self) -> None:
        """Refuses queries until ``begin`` is called: after a jump back, the maps lie in the future."""
        self._replies = None

    def close(self) -> None:
        """Closes the log."""
        if self._maps is not None:
            self._maps.close()

    def _ready(self) -> Replies:
        if self._replies is None:
            raise Refused("not_recorded", "the recording tells nothing of the maps (yet)")
        return self._replies


def _settings(config: FusionConfig, store: Path) -> FusionSettings:
    """Fusion's settings with which it has that configuration."""
    parts = {name: getattr(config, name).model_dump() for name in type(config).model_fields}
    return FusionSettings(store=str(store), **parts)
