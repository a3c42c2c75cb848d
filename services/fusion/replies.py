"""Answers to queries: layers of the maps, and objects."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, cast

import msgspec

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.errors import BusError, PerceptionError
from surveilnav.messages import LAYERS, LayerHeader, ObjectList, ObjectRecord, ViewPicture
from surveilnav.messages.maps import LayerName
from surveilnav.perception.prompts import value_prompt
from surveilnav.sensing.packing import pack_array
from surveilnav.services.fusion.core import FusionConfig, JointMap
from surveilnav.services.fusion.durable_map import DurableMap
from surveilnav.services.fusion.perception_client import PerceptionClient, TextEmbedding
from surveilnav.services.fusion.robot_places import RobotPlaces
from surveilnav.services.fusion.store import StoreError

DType = Literal["uint8", "float32", "int64"]
_MAX_TEXT_CHARS = 200


class Replies:
    """Called from the threads that serve queries."""

    def __init__(
        self, node: Node, config: FusionConfig, maps: DurableMap, perception: PerceptionClient, places: RobotPlaces
    ) -> None:
        self._node, self._config, self._maps, self._perception, self._places = node, config, maps, perception, places

    # --- layers ---------------------------------------------------------------------------------------------------

    def layer(self, request: Request) -> Answer:
        """One layer of a floor; the value layer is of the target that the parameter ``target`` names."""
        floor, layer, target = request.ids.get("floor"), request.ids.get("layer"), request.parameters.get("target", "")
        if floor is None or layer not in LAYERS:
            raise Refused("unknown_layer", f"ask for map/FLOOR/LAYER, with a layer of {', '.join(LAYERS)}")
        text = self._embedded(target, value_prompt(target)) if layer == "value" else None
        try:
            if text is not None:
                self._build_value(floor, text)
            with self._maps.lock:
                joint = self._joint_with(floor)
                grid, array = joint.layer(floor, layer, *(text or ()))
                left_out = joint.views_left_out(floor, text.model) if text else 0
                revision = joint.floor_revision(floor)
                source_sets = joint.source_sets(floor) if layer == "provenance" else []
        except KeyError as error:
            raise Refused("unknown_floor", str(error.args[0])) from error
        if left_out:
            self._node.warn_seldom(
                "a value layer leaves out views that another model embedded", floor=floor, views=left_out
            )
        header = LayerHeader(
            stamp_ns=clock_ns(),
            floor=floor,
            layer=cast("LayerName", layer),
            revision=revision,
            grid=grid,
            dtype=cast("DType", str(array.dtype)),
            shape=array.shape,
            target=target,
            source_sets=source_sets,
            views_left_out=left_out,
        )
        return Answer(header, pack_array(array))

    def _build_value(self, floor: str, text: TextEmbedding) -> None:
        """A new target's layer takes every view kept: it is built while the maps go on."""
        with self._maps.lock:
            pending = self._joint_with(floor).pending_value(floor, *text)
        if pending is not None:
            pending.build()
            with self._maps.lock:
                self._joint_with(floor).adopt_value(floor, pending)

    def _joint_with(self, floor: str) -> JointMap:
        """The joint maps, or ones that know nothing of a floor where a robot stands whose views were all refused."""
        joint, place = self._maps.joint, self._places.on(floor)
        processed = any(last.floor == floor for last in list(self._maps.contents.robots.values()))
        if joint.knows(floor) or place is None or not processed:
            return joint
        return JointMap.unseen(floor, place.z_m, (place.x_m, place.y_m), self._config)

    def _embedded(self, said: str, prompt: str) -> TextEmbedding:
        """The embedding of a prompt made of what somebody said."""
        if not 1 <= len(said) <= _MAX_TEXT_CHARS:
            raise Refused(
                "bad_target", f"say what is looked for in 1 to {_MAX_TEXT_CHARS} characters: target=… or text=…"
            )
        try:
            return self._perception.text_embedding(prompt)
        except Refused:
            raise
        except (BusError, PerceptionError) as error:
            raise Refused(
                "perception_down", f"nothing tells what {said!r} means without perception: {error}"
            ) from error

    # --- objects --------------------------------------------------------------------------------------------------

    def objects(self, request: Request) -> list[Answer]:
        """All objects of one floor or of all; ``object=ID``: only that one; both it and ``history=all``: all events;
        ``text=...``: with how well each fits, by its kept embedding; ``detail=brief``: without points and events."""
        floor, wanted = request.ids.get("floor"), request.parameters.get("object", "")
        if wanted and not (wanted.isascii() and wanted.isdigit() and floor is not None):
            raise Refused("unknown_object", "ask objects/FLOOR?object=ID, ID a number")
        said = request.parameters.get("text")
        text = None if said is None else self._embedded(said, said)
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
        """A picture that the maps took, while the log has it."""
        asked = request.parameters
        source, numbers = asked.get("source", ""), [asked.get("view", ""), asked.get("seq", "")]
        if not all(n.isascii() and n.isdigit() and len(n) <= 18 for n in numbers):
            raise Refused("unknown_picture", "ask view_picture/FLOOR?source=SOURCE;view=N;seq=N")
        view, seq = map(int, numbers)
        try:
            jpeg = self._maps.picture(source, view, seq)
        except (StoreError, msgspec.MsgspecError) as error:
            raise Refused("store_down", f"the picture can't be read: {error}") from error
        if jpeg is None:
            raise Refused("unknown_picture", f"picture {seq} of {source[:80]}, view {view}, isn't kept (any more)")
        return Answer(ViewPicture(stamp_ns=clock_ns(), source=source, view=view, seq=seq), jpeg)

    def _objects_of(self, floor: str | None, text: TextEmbedding | None) -> list[tuple[str, list[ObjectRecord], int]]:
        """(floor, its objects, its revision) of one floor, or of all."""
        with self._maps.lock:
            found = []
            for name in [floor] if floor is not None else sorted(self._maps.joint.floors):
                try:
                    joint = self._joint_with(name)
                    fits = joint.relevances(name, *text) if text else {}
                    found.append((name, _with_relevance(joint.objects(name), fits), joint.floor_revision(name)))
                except KeyError as error:
                    raise Refused("unknown_floor", str(error.args[0])) from error
        return found

    def _with_history(self, record: ObjectRecord) -> ObjectRecord:
        try:
            history = self._maps.history(record.floor, record.id)
        except StoreError as error:
            raise Refused("store_down", f"the whole history can't be read: {error}") from error
        # after trouble with the file, or once its oldest events went, the record may know more
        if not history or (record.history and record.history[0] not in history):
            return record
        return msgspec.structs.replace(record, history=history)


def _with_relevance(objects: list[ObjectRecord], fits: Mapping[int, float | None]) -> list[ObjectRecord]:
    return [msgspec.structs.replace(o, relevance=fits[o.id]) if o.id in fits else o for o in objects]
