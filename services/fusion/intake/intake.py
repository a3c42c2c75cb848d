"""View intake: subscribes to robots and cameras, and has perception look at every new picture."""

from __future__ import annotations

import time
from collections.abc import Mapping

from surveilnav.bus import Node, Received
from surveilnav.messages import CameraInfo, FrameHeader
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.intake.camera_searches import CameraSearches
from surveilnav.services.fusion.intake.perception import PerceptionClient
from surveilnav.services.fusion.intake.pictures import PictureCache
from surveilnav.services.fusion.intake.ranking import ViewRanking
from surveilnav.services.fusion.intake.robot_positions import RobotPositions
from surveilnav.services.fusion.intake.sources import InvokedCamera, Sources
from surveilnav.services.fusion.intake.texts import TextEncoder
from surveilnav.services.fusion.intake.wanted_pictures import WantedPictures
from surveilnav.services.fusion.intake.words import SearchedWords
from surveilnav.services.fusion.intake.workers import Workers
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.perceived import PerceivedView, ViewKey
from surveilnav.services.fusion.shard import Shard

_WORDS_PERIOD_S = 0.2  # between two checks of what missions search for


class ViewIntake:
    """Takes frames from the bus and returns them as perceived views.

    Attributes:
        searches: the open searches with cameras alone.
        texts: embeds texts with the model that embeds the views.
    """

    def __init__(self, node: Node, settings: FusionSettings, maps: BuildingMaps, shard: Shard) -> None:
        self._views_per_step = settings.camera_views_per_step
        self.searches = CameraSearches()
        self._words = SearchedWords(node, settings.prompts, self.searches)
        self._wanted = WantedPictures(self._words)
        self.positions = RobotPositions()
        ranking = ViewRanking(maps, self.positions)
        self._sources = Sources(node, settings, maps, shard, self._words, self.searches, ranking, self._wanted)
        self._pictures = PictureCache(settings.picture_cache_mb << 20)
        self._workers = Workers(node)
        self.texts = TextEncoder(self._workers)
        self._perception = PerceptionClient(node, settings, self._workers, maps, self._words, ranking, self._wanted)
        self._faulty: dict[ViewKey, PerceivedView] = {}
        self._perceived_for: tuple[frozenset[str], str] = frozenset(), ""  # words and embedding model of the last check
        self._words_s = 0.0

    @property
    def cameras(self) -> Mapping[str, InvokedCamera]:
        """The cameras that are invoked now, by name."""
        return self._sources.cameras

    def announced_cameras(self) -> list[CameraInfo]:
        """All cameras of the shard that have announced themselves, invoked or not. Safe from any thread."""
        return self._sources.infos()

    def is_perceiving(self, camera: str) -> bool:
        """Whether a view of a camera waits for perception, or for the maps. Safe from any thread."""
        return self._perception.has_views_of(f"camera/{camera}")

    def awaits_pictures(self, camera: str) -> bool:
        """Whether pictures of a camera that looks by itself are wanted and may come. Safe from any thread."""
        invoked = self._sources.cameras.get(camera)
        return invoked is not None and not invoked.gives_no_pictures and bool(self._wanted.of(camera))

    def pictures_awaited(self) -> dict[str, int]:
        """By such camera, of how many views. Safe from any thread."""
        return {
            camera: len(views) for camera, views in self._wanted.by_camera().items() if self.awaits_pictures(camera)
        }

    @property
    def problem(self) -> str:
        """Why perception doesn't answer at the moment; "" while it does."""
        return self._perception.problem

    def poll(self) -> bool:
        """Invokes cameras (eq. 1), receives the newest frame of every view, and hands it to perception.

        Returns:
            Whether any frame has arrived.
        """
        frames, dropped = self._sources.poll()
        for source in dropped:
            self._perception.withdraw(source)
            self._pictures.drop_source(source)
        self._perceive_again_for_new_words()
        for frame in frames:
            self._submit(frame)
        return bool(frames)

    def pop_perceived(self) -> list[PerceivedView]:
        """Views that are ready for the maps: all of robots or, if there are none, a few of cameras."""
        faulty, self._faulty = list(self._faulty.values()), {}
        return faulty + (self._perception.pop_robots() or self._perception.pop_cameras(self._views_per_step))

    def withdraw(self, removal: Removal) -> None:
        """Drops views of a camera that are under way and that a removal takes away."""
        self._sources.withdraw(removal)
        self._perception.withdraw_removed(removal)
        self._pictures.drop_source(removal.source)
        self._faulty = {k: p for k, p in self._faulty.items() if not removal.includes(k[0], p.header.stamp_ns)}

    def request_again(self, source: str) -> None:
        """Has a camera send all its views again, because the maps don't hold them any more."""
        self._sources.request_again(source)

    def _submit(self, frame: Received[FrameHeader]) -> None:
        header = frame.message
        if fault := self._sources.wrong_intrinsics(header):
            key = header.source, header.view
            self._faulty[key] = PerceivedView(key, header, fault=fault, request_id=frame.request_id)
            return
        self.positions.record(header)
        self._pictures.put(frame)
        self._perception.submit(frame)

    def _perceive_again_for_new_words(self) -> None:
        """Sends the cached pictures of cameras to perception again if its answers would now be different.

        That is so if a mission searches for a word that these pictures weren't searched for, or if another model embeds views.
        """
        now_s = time.monotonic()
        if now_s - self._words_s < _WORDS_PERIOD_S:
            return
        self._words_s = now_s
        words, embedder = frozenset(self._perception.words()), self._workers.embedder
        former_words, former_embedder = self._perceived_for
        if words - former_words or embedder != former_embedder:
            self._perception.resubmit(self._pictures.frames())
        self._perceived_for = words, embedder
