"""The fusion service: views in, joint maps out."""

from __future__ import annotations

import time
from collections.abc import Iterable

from surveilnav.bus import Answer, Node, Received, Request, clock_ns
from surveilnav.contract import FORGET_PICTURES, MAP_LAYER, MAP_REVISION, MAP_SNAPSHOT, OBJECTS, VIEW_LOG, VIEW_PICTURE
from surveilnav.messages import FrameHeader, PicturesForgotten
from surveilnav.services.fusion.answers.history import History
from surveilnav.services.fusion.answers.replies import Replies
from surveilnav.services.fusion.answers.revisions import Revisions
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.intake.perception import PerceptionClient
from surveilnav.services.fusion.intake.pictures import KeptPictures
from surveilnav.services.fusion.intake.ranking import ViewChoice
from surveilnav.services.fusion.intake.sources import Sources
from surveilnav.services.fusion.intake.words import Words
from surveilnav.services.fusion.map_log.log import DurableMap
from surveilnav.services.fusion.records import PerceivedView
from surveilnav.services.fusion.robot_places import RobotPlaces

_WORDS_S = 0.2  # between two looks at what missions search for


class FusionService:
    """Follows robots, invokes cameras, has perception look at every new view, and keeps the joint maps."""

    def __init__(self, node: Node, settings: FusionSettings, keep_pictures_s: float | None = None) -> None:
        config = settings.core()
        self._views_per_step = settings.camera_views_per_step
        self._node, self._maps = node, DurableMap(node, settings, keep_pictures_s)
        words = Words(node, settings.prompts)
        self._sources = Sources(
            node,
            settings,
            config.map,
            self._maps.contents.robots,
            lambda camera: self._maps.contents.views_of(camera),
            words.idle,
        )
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
        node.serve(FORGET_PICTURES, self._on_forget, keeper=node.id)
        history = History(config, self._maps)
        node.serve(VIEW_LOG, history.view)
        node.serve(MAP_SNAPSHOT, history.snapshot)

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

    def _on_forget(self, request: Request) -> Answer:
        stored = self._maps.forget_pictures()
        self._node.log.warning("forgets pictures", reason=request.message.reason)
        said = "pictures go from the store within seconds" if stored else "no store, so there are no past pictures"
        return Answer(PicturesForgotten(stamp_ns=clock_ns(), keeper=self._node.id, message=said))

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
