"""Gets all maps of a floor from fusion in one query, as they are at one moment, and transfers only what has changed."""

from __future__ import annotations

from numpy.typing import NDArray

from surveilnav.bus import Node
from surveilnav.contract import FLOOR_MAPS
from surveilnav.errors import WireError
from surveilnav.messages import FloorMapsHeader, ObjectRecord, Revision
from surveilnav.sensing.layers import GRID_LAYERS, unpack_parts
from surveilnav.services.planner.core import FloorMaps


class FloorMapsClient:
    """Asks fusion for the maps of a floor. Keeps the last answer, so that the next needs only the changes. For one thread."""

    def __init__(self, node: Node, target: str, timeout_s: float) -> None:
        """``target``: the target whose value layer is wanted."""
        self._node, self._target, self._timeout_s = node, target, timeout_s
        self._floor, self._epoch, self._revision = "", "", -1
        self._layers: dict[str, NDArray] = {}
        self._objects: dict[int, ObjectRecord] = {}

    def maps_at(self, revision: Revision, robot: str) -> FloorMaps:
        """The maps of the revision's floor, of this revision or a later one. In them, the robot's newest observation is the same.

        Raises:
            Unanswered, Refused: fusion doesn't answer, or refuses.
            WireError: parts of the answer are missing, or it contains another observation of the robot.
        """
        if revision.floor != self._floor:
            self._forget()
        parameters = {"target": self._target}
        if self._epoch:
            parameters |= {"epoch": self._epoch, "since": str(self._revision)}
        received = self._node.ask(FLOOR_MAPS, floor=revision.floor, timeout_s=self._timeout_s, parameters=parameters)
        header: FloorMapsHeader = received.message
        try:
            self._update(header, received.payload)
        except WireError:
            self._forget()  # so that the next query asks for everything
            raise
        if header.robots.get(robot) != revision.robots.get(robot):
            raise WireError(
                f"expected maps with observation {revision.robots.get(robot)} of robot {robot}, got those with "
                f"{header.robots.get(robot)}"
            )
        return FloorMaps(
            floor=revision.floor,
            floor_z_m=revision.floor_z_m,
            grid=header.grid,
            occupancy=self._layers["occupancy"],
            explored=self._layers["explored"],
            frontier=self._layers["frontier"],
            value=self._layers["value"],
            objects=[self._objects[id_] for id_ in header.object_ids],
            revision=header.revision,
            pending_views=header.pending_views,
            removals=header.removals,
        )

    def _update(self, header: FloorMapsHeader, payload: bytes) -> None:
        """Applies the changes to the last answer. WireError: something is missing, or they are changes of another revision."""
        if header.since not in (-1, self._revision):
            raise WireError(f"expected changes since revision {self._revision}, got those since {header.since}")
        layers, objects = unpack_parts(header, payload), {record.id: record for record in header.objects}
        if header.since >= 0:
            layers, objects = self._layers | layers, self._objects | objects
        lacking = [name for name in GRID_LAYERS if name not in layers or layers[name].shape != header.grid.shape]
        unknown = [id_ for id_ in header.object_ids if id_ not in objects]
        if lacking or unknown:
            raise WireError(
                f"the maps of floor {header.floor!r} lack the layers {lacking} and the objects {unknown[:9]}"
            )
        self._layers, self._objects = layers, {id_: objects[id_] for id_ in header.object_ids}
        self._floor, self._epoch, self._revision = header.floor, header.epoch, header.revision

    def _forget(self) -> None:
        self._floor, self._epoch, self._revision = "", "", -1
        self._layers, self._objects = {}, {}
