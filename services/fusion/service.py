"""The fusion service: integrates perceived views into the joint maps, announces each revision, and answers queries."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from surveilnav.bus import Answer, Node, Request, clock_ns
from surveilnav.contract import (
    CAMERA_SEARCH,
    FLOOR_MAPS,
    FORGET_PICTURES,
    MAP_LAYER,
    MAP_REVISION,
    MAP_SNAPSHOT,
    OBJECTS,
    VIEW_LOG,
    VIEW_PICTURE,
    Stream,
)
from surveilnav.messages import PicturesForgotten
from surveilnav.services.fusion.answers.camera_search import CameraSearchAnswers
from surveilnav.services.fusion.answers.floor_maps import FloorMapsAnswers
from surveilnav.services.fusion.answers.layers import LayerAnswers
from surveilnav.services.fusion.answers.log import LogAnswers
from surveilnav.services.fusion.answers.objects import ObjectAnswers
from surveilnav.services.fusion.answers.reader import MapReader
from surveilnav.services.fusion.answers.removals import RemovalAnswers
from surveilnav.services.fusion.answers.revisions import Revisions
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.config import FusionSettings
from surveilnav.services.fusion.intake.intake import ViewIntake
from surveilnav.services.fusion.map_log.log import MapLog
from surveilnav.services.fusion.map_log.removal import Removal
from surveilnav.services.fusion.shard import WHOLE_BUILDING, Shard

_Handler = Callable[[Request], Answer | list[Answer]]


class FusionService:
    """Keeps the joint maps of a building's shard: follows robots, invokes cameras, has perception process every new view."""

    def __init__(
        self, node: Node, settings: FusionSettings, keep_pictures_s: float | None = None, shard: Shard = WHOLE_BUILDING
    ) -> None:
        """``keep_pictures_s``: how long pictures may stay in the log; None: as long as the log needs them."""
        self._node, self._shard = node, shard
        self._maps = BuildingMaps(settings.core())
        self._log = MapLog(node, settings, self._maps, keep_pictures_s)
        self._intake = ViewIntake(node, settings, self._maps, self._shard)
        self._revisions = Revisions(node, self._maps, self._intake, self._log)
        self._removals = RemovalAnswers(node, self._log.removals)
        if settings.store and not self._maps.joint.revision and not self._log.problem:
            node.log.warning("the store has no maps: they begin empty", store=settings.store)
        self._serve()

    def _serve(self) -> None:
        """Starts to answer queries, on threads of the node."""
        reader = MapReader(self._maps, self._intake.texts, self._intake.positions)
        objects, log = ObjectAnswers(reader, self._log), LogAnswers(self._node.id, self._maps, self._log)
        # a query for a value layer may wait for perception; more workers keep other queries from waiting behind it
        self._serve_floors(FLOOR_MAPS, FloorMapsAnswers(reader, self._revisions).floor_maps, workers=3)
        self._serve_floors(MAP_LAYER, LayerAnswers(self._node, reader).layer, workers=3)
        self._serve_floors(OBJECTS, objects.objects)
        self._serve_floors(VIEW_PICTURE, objects.picture)
        self._serve_floors(MAP_REVISION, self._revisions.answer)
        search = CameraSearchAnswers(self._node, self._maps, self._intake, self._shard)
        self._node.serve(CAMERA_SEARCH, search.search, workers=2, fusion=self._node.id)
        self._node.serve(FORGET_PICTURES, self._on_forget, keeper=self._node.id)
        self._node.serve(VIEW_LOG, log.view)
        self._node.serve(MAP_SNAPSHOT, log.snapshot)

    def _serve_floors(self, stream: Stream, handler: _Handler, workers: int = 1) -> None:
        """Answers queries about the shard's floors, each on a key of its own: other floors have other services."""
        if self._shard.floors is None:
            self._node.serve(stream, handler, workers=workers)
            return
        for floor in sorted(self._shard.floors):

            def answer(request: Request, floor: str = floor) -> Answer | list[Answer]:
                return handler(replace(request, ids={**request.ids, "floor": floor}))  # one to all floors names none

            self._node.serve(stream, answer, workers=workers, floor=floor)

    def step(self) -> bool:
        """One turn of the main loop; True if there was something to do."""
        # invoke cameras (eq. 1), receive the newest frame of each view, and send it to perception
        arrived = self._intake.poll()
        # log the views that perception has finished, and integrate them; while views wait for the disk, take no more
        perceived = [] if self._log.is_blocked else self._intake.pop_perceived()
        self._log.integrate(perceived)
        self._node.report_problem("store", self._log.problem)
        for removal in self._log.removals.pop_changes():
            self._on_removal(removal)
        # announce what the maps now hold
        self._revisions.publish()
        self._removals.publish()
        return bool(arrived or perceived)

    def close(self) -> None:
        """Waits until a snapshot that is being written is finished, and closes the log."""
        self._log.close()

    def _on_removal(self, removal: Removal) -> None:
        """Drops a camera's views that are under way when a removal begins, and has the camera looked through anew at its end.

        A robot's view that is under way counts as later: its mission waits for it.
        """
        if removal.state == "done":
            self._intake.request_again(removal.source)
        elif removal.source.startswith("camera/"):
            self._log.withdraw(removal)
            self._intake.withdraw(removal)

    def _on_forget(self, request: Request) -> Answer:
        has_file = self._log.forget_pictures()
        self._node.handover.clear()
        self._node.log.warning("forgets pictures", reason=request.message.reason)
        message = "pictures go from the store within seconds" if has_file else "no store, so there are no past pictures"
        return Answer(PicturesForgotten(stamp_ns=clock_ns(), keeper=self._node.id, message=message))
