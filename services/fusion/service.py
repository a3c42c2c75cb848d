"""The fusion service: views in, joint maps out."""

from __future__ import annotations

import time
from collections.abc import Iterable

from services.fusion.config import FusionSettings
from services.fusion.durable_map import DurableMap
from services.fusion.kept_pictures import KeptPictures
from services.fusion.perception_client import PerceptionClient
from services.fusion.records import PerceivedView
from services.fusion.replies import Replies
from services.fusion.revisions import Revisions
from services.fusion.robot_places import RobotPlaces
from services.fusion.sources import Sources
from services.fusion.view_choice import ViewChoice
from services.fusion.words import Words
from surveilnav.bus import Node, Received
from surveilnav.contract import MAP_LAYER, MAP_REVISION, OBJECTS, VIEW_PICTURE
from surveilnav.messages import FrameHeader

_WORDS_S = 0.2  # between two looks at what missions search for


class FusionService:
    """Follows robots, invokes cameras, has perception look at every new view, and keeps the joint maps."""

    def __init__(self, node: Node, settings: FusionSettings) -> None:
        config = settings.core()
        self._views_per_step = settings.camera_views_per_step
        self._maps = DurableMap(node, settings)
        words = Words(node, settings.prompts)
        self._sources = Sources(
            node, settings, config.map, self._maps.contents.robots,
            lambda camera: self._maps.contents.views_of(camera), words.idle,
        )  # fmt: skip
        self._places = RobotPlaces()
        choice = ViewChoice(self._maps, self._places, config)
        self._perception = PerceptionClient(node, settings, self._maps.holds, words.now, choice.next_of)
        self._pictures = KeptPictures(settings.kept_pictures_mb << 20)
        self._looked_for, self._embedder, self._asked_s = frozenset[str](), "", 0.0
        self._revisions = Revisions(node, config.map, self._maps, self._perception, self._places, self._sources.cameras)
        replies = Replies(node, config, self._maps, self._perception, self._places)
        # a value layer may wait for perception: the others must not wait with it
        node.serve(MAP_LAYER, replies.layer, workers=3)
        node.serve(OBJECTS, replies.objects)
        node.serve(VIEW_PICTURE, replies.picture)
        node.serve(MAP_REVISION, self._revisions.answer)

    def step(self) -> bool:
        """One turn of the loop; True if there was something to do."""
        # active camera invocation (eq. 1), and the newest frame of everybody
        frames, dropped = self._sources.poll()
        for source in dropped:
            self._perception.withdraw(source)
            self._pictures.drop(source)
        self._look_again()
        # perception looks at what is new
        finished = [*self._submit(frames), *self._perceived()]
        # joint maps: logged, then taken, then told of
        self._maps.take(finished)
        self._revisions.publish()
        return bool(frames or finished)

    def close(self) -> None:
        """Ends what is being written."""
        self._maps.close()

    def _submit(self, frames: Iterable[Received[FrameHeader]]) -> list[PerceivedView]:
        """Has perception look at frames; returns those that nobody needs to look at, since they can't be."""
        faulty = []
        for frame in frames:
            header = frame.message
            if fault := self._sources.wrong_intrinsics(header):
                faulty.append(PerceivedView((header.source, header.view), header, fault=fault))
                continue
            self._places.note(header)
            self._pictures.put(frame)
            self._perception.submit(frame)
        return faulty

    def _look_again(self) -> None:
        """Has perception look at the cameras' pictures again when a mission brings a word that it didn't look for, or when
        another model embeds them."""
        now_s = time.monotonic()
        if now_s - self._asked_s < _WORDS_S:
            return
        self._asked_s = now_s
        words, embedder = frozenset(self._perception.words()), self._perception.embedder
        if words - self._looked_for or embedder != self._embedder:
            self._perception.look_again(self._pictures.all())
        self._looked_for, self._embedder = words, embedder

    def _perceived(self) -> list[PerceivedView]:
        """Robots' views first; cameras' in slices, so that a robot never waits for many."""
        if self._maps.store_blocked:  # they wait where there is room for few
            return []
        return self._perception.robots() or self._perception.cameras(self._views_per_step)
