"""Answers with all maps of one floor at one moment: everything that a planner bases a decision on.

The client says which revision it has, and gets only what has changed since: layers that differ, and objects with new events.
Everything in an answer is read while one lock is held, so that no decision mixes two revisions.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from surveilnav.bus import Answer, Refused, Request, clock_ns
from surveilnav.geometry import Grid
from surveilnav.messages import FloorMapsHeader, LayerPart
from surveilnav.perception.prompts import value_prompt
from surveilnav.sensing.layers import GRID_LAYERS
from surveilnav.sensing.packing import pack_array
from surveilnav.services.fusion.answers.parameters import number_of
from surveilnav.services.fusion.answers.reader import MapReader
from surveilnav.services.fusion.answers.revisions import Revisions

_MAX_LAYERS = 256  # that are kept as they were last sent, over all floors and targets


@dataclass(frozen=True, slots=True, eq=False)
class _AnsweredLayer:
    """A layer as it was last sent.

    Attributes:
        changed_at: the revision at which it was first sent as it is now. It may have changed before that, but not since.
        newest_at: the newest revision at which it was compared.
    """

    grid: Grid
    array: NDArray[np.generic]
    packed: bytes
    changed_at: int
    newest_at: int


class FloorMapsAnswers:
    """Answers queries for the maps of a floor. Thread-safe."""

    def __init__(self, reader: MapReader, revisions: Revisions) -> None:
        self._reader, self._maps, self._revisions = reader, reader.maps, revisions
        self._lock = threading.Lock()
        self._answered: OrderedDict[tuple[str, str, str, str], _AnsweredLayer] = OrderedDict()

    def floor_maps(self, request: Request) -> Answer:
        """The maps of a floor.

        Parameters: ``target`` of the value layer; ``epoch`` and ``since``, the epoch and the revision that the client has.
        Without these two, or if its epoch is another one, it gets everything.
        """
        floor, target = request.ids.get("floor"), request.parameters.get("target", "")
        if floor is None:
            raise Refused("unknown_floor", "ask for floor_maps/FLOOR?target=WORDS")
        text = self._reader.embedding(target, value_prompt(target))
        try:
            self._reader.build_value(floor, text)
            # one moment: nothing is integrated while the lock is held
            with self._maps.lock:
                joint, epoch, removals = self._reader.joint_of(floor), self._maps.epoch, self._maps.removals
                since = _since(request, epoch)
                revision = joint.floor_revision(floor)
                layers = {name: joint.layer(floor, name, *(text if name == "value" else ())) for name in GRID_LAYERS}
                objects, ids = joint.objects(floor, since), joint.object_ids(floor)
                robots = {robot: last.seq for robot, last in self._maps.processed.robots.items() if last.floor == floor}
        except KeyError as error:
            raise Refused("unknown_floor", str(error.args[0])) from error
        grid = layers["occupancy"][0]
        key = epoch, floor, f"{text.model} {target}"
        changed, payload = self._changed(key, layers, revision, since)
        header = FloorMapsHeader(
            stamp_ns=clock_ns(),
            floor=floor,
            target=target,
            epoch=epoch,
            revision=revision,
            since=since,
            grid=grid,
            layers=changed,
            objects=objects,
            object_ids=ids,
            robots=robots,
            pending_views=self._revisions.pending_views(floor),
            removals=removals,
        )
        return Answer(header, payload)

    def _changed(
        self,
        key: tuple[str, str, str],
        layers: dict[str, tuple[Grid, NDArray[np.generic]]],
        revision: int,
        since: int,
    ) -> tuple[list[LayerPart], bytes]:
        """The layers that have changed since revision ``since``, and their concatenated bytes.

        Args:
            key: epoch, floor, and the model and target of the value layer.
        """
        parts, payload = [], b""
        with self._lock:
            for name, (grid, array) in layers.items():
                answered, is_first = self._update((*key, name), grid, array, revision)
                if answered.changed_at > since or is_first:
                    dtype = cast("Literal['uint8', 'float32']", str(array.dtype))
                    parts.append(LayerPart(name, dtype, array.shape, len(answered.packed)))  # type: ignore[arg-type]
                    payload += answered.packed
        return parts, payload

    def _update(
        self, key: tuple[str, str, str, str], grid: Grid, array: NDArray[np.generic], revision: int
    ) -> tuple[_AnsweredLayer, bool]:
        """Compares a layer with what was last sent of it, and keeps it for the next comparison.

        Returns:
            The layer with the revision at which it last changed, and whether nothing is known of what it was before.
        """
        last = self._answered.get(key)
        if last is not None and last.newest_at > revision:  # meanwhile, another thread has sent a newer one
            return _AnsweredLayer(grid, array, pack_array(array), revision, revision), True
        is_value = array.dtype.kind == "f"
        if last is not None and last.grid == grid and np.array_equal(last.array, array, equal_nan=is_value):
            answered = replace(last, newest_at=revision)
        else:
            answered = _AnsweredLayer(grid, array, pack_array(array), revision, revision)
        self._answered[key] = answered
        self._answered.move_to_end(key)
        while len(self._answered) > _MAX_LAYERS:
            self._answered.popitem(last=False)
        return answered, last is None


def _since(request: Request, epoch: str) -> int:
    """The revision that the client has; -1 if it has none of this epoch."""
    since = number_of(request, "since")
    return -1 if since is None or request.parameters.get("epoch") != epoch else since
