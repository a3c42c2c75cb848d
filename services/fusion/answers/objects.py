"""Answers about objects, their histories, and the pictures in which they were seen."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from surveilnav.bus import Answer, Refused, Request, clock_ns
from surveilnav.messages import ObjectList, ObjectRecord, ViewPicture
from surveilnav.services.fusion.answers.parameters import number_of
from surveilnav.services.fusion.answers.reader import MapReader
from surveilnav.services.fusion.intake.texts import TextEmbedding
from surveilnav.services.fusion.map_log.log import MapLog
from surveilnav.services.fusion.map_log.store import StoreError


class ObjectAnswers:
    """Answers queries for objects and for pictures. Thread-safe."""

    def __init__(self, reader: MapReader, log: MapLog) -> None:
        self._reader, self._log = reader, log

    def objects(self, request: Request) -> list[Answer]:
        """The objects of one floor or of all.

        Parameters: ``object=ID`` selects one object. With it, or with ``history=all``, objects have all their events.
        ``text=...`` adds the relevance of each object to a text. ``detail=brief`` leaves out points and events.
        """
        floor, wanted = request.ids.get("floor"), request.parameters.get("object", "")
        if wanted and (number_of(request, "object") is None or floor is None):
            raise Refused("unknown_object", "ask objects/FLOOR?object=ID, ID a number")
        query = request.parameters.get("text")
        text = None if query is None else self._reader.embedding(query, query)
        answers = []
        for name, objects, revision in self._objects_of(floor, text):
            if wanted:
                objects = [o for o in objects if o.id == int(wanted)]
                if not objects:
                    raise Refused("unknown_object", f"floor {name!r} has no object {wanted} (any more)")
            if wanted or request.parameters.get("history") == "all":
                objects = [self._with_history(o) for o in objects]
            elif request.parameters.get("detail") == "brief":
                objects = [msgspec.structs.replace(o, points=b"", history=[]) for o in objects]
            message = ObjectList(stamp_ns=clock_ns(), floor=name, revision=revision, objects=objects)
            answers.append(Answer(message, ids={"floor": name}))
        return answers

    def picture(self, request: Request) -> Answer:
        """The picture of an integrated view, as long as the log has it."""
        given = request.parameters
        source, numbers = given.get("source", ""), [given.get("view", ""), given.get("seq", "")]
        if not all(n.isascii() and n.isdigit() and len(n) <= 18 for n in numbers):
            raise Refused("unknown_picture", "ask view_picture/FLOOR?source=SOURCE;view=N;seq=N")
        view, seq = map(int, numbers)
        try:
            jpeg = self._log.picture(source, view, seq)
        except (StoreError, msgspec.MsgspecError) as error:
            raise Refused("store_down", f"the picture can't be read: {error}") from error
        if jpeg is None:
            raise Refused("unknown_picture", f"picture {seq} of {source[:80]}, view {view}, isn't kept (any more)")
        return Answer(ViewPicture(stamp_ns=clock_ns(), source=source, view=view, seq=seq), jpeg)

    def _objects_of(self, floor: str | None, text: TextEmbedding | None) -> list[tuple[str, list[ObjectRecord], int]]:
        """(floor, its objects, its revision) of one floor or of all."""
        maps = self._reader.maps
        with maps.lock:
            found = []
            for name in [floor] if floor is not None else sorted(maps.joint.floors):
                try:
                    joint = self._reader.joint_of(name)
                    fits = joint.relevances(name, *text) if text else {}
                    found.append((name, _with_relevance(joint.objects(name), fits), joint.floor_revision(name)))
                except KeyError as error:
                    raise Refused("unknown_floor", str(error.args[0])) from error
        return found

    def _with_history(self, record: ObjectRecord) -> ObjectRecord:
        try:
            history = self._log.object_history(record.floor, record.id)
        except StoreError as error:
            raise Refused("store_down", f"the whole history can't be read: {error}") from error
        # after errors of the file, or once its oldest events were dropped, the record may have more events
        if not history or (record.history and record.history[0] not in history):
            return record
        return msgspec.structs.replace(record, history=history)


def _with_relevance(objects: list[ObjectRecord], fits: Mapping[int, float | None]) -> list[ObjectRecord]:
    return [msgspec.structs.replace(o, relevance=fits[o.id]) if o.id in fits else o for o in objects]
