"""Answers about single map layers."""

from __future__ import annotations

from typing import Literal, cast

from surveilnav.bus import Answer, Node, Refused, Request, clock_ns
from surveilnav.messages import LAYERS, LayerHeader
from surveilnav.messages.maps import LayerName
from surveilnav.perception.prompts import value_prompt
from surveilnav.sensing.packing import pack_array
from surveilnav.services.fusion.answers.reader import MapReader

DType = Literal["uint8", "float32", "int64"]


class LayerAnswers:
    """Answers queries for single layers. Thread-safe."""

    def __init__(self, node: Node, reader: MapReader) -> None:
        self._node, self._reader, self._maps = node, reader, reader.maps

    def layer(self, request: Request) -> Answer:
        """One layer of a floor; the value layer is that of the target in the parameter ``target``."""
        floor, layer, target = request.ids.get("floor"), request.ids.get("layer"), request.parameters.get("target", "")
        if floor is None or layer not in LAYERS:
            raise Refused("unknown_layer", f"ask for map/FLOOR/LAYER, with a layer of {', '.join(LAYERS)}")
        text = self._reader.embedding(target, value_prompt(target)) if layer == "value" else None
        try:
            if text is not None:
                self._reader.build_value(floor, text)
            with self._maps.lock:
                joint = self._reader.joint_of(floor)
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
