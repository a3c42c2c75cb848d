"""What several kinds of answers need: the maps of a floor, and embeddings of texts."""

from __future__ import annotations

from surveilnav.bus import Refused
from surveilnav.errors import BusError, PerceptionError
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.fusion.intake.robot_positions import RobotPositions
from surveilnav.services.fusion.intake.texts import TextEmbedding, TextEncoder

_MAX_TEXT_CHARS = 200


class MapReader:
    """Reads the maps for the threads that answer queries."""

    def __init__(self, maps: BuildingMaps, texts: TextEncoder, positions: RobotPositions) -> None:
        self.maps = maps
        self._texts, self._positions = texts, positions

    def joint_of(self, floor: str) -> JointMap:
        """The joint maps for queries about a floor. The caller holds ``maps.lock``.

        If a robot is on a floor whose views were all refused so far, these are empty maps of that floor.
        """
        joint, position = self.maps.joint, self._positions.latest_on(floor)
        processed = any(last.floor == floor for last in list(self.maps.processed.robots.values()))
        if joint.knows(floor) or position is None or not processed:
            return joint
        return JointMap.unseen(floor, position.z_m, (position.x_m, position.y_m), joint.config)

    def embedding(self, text: str, prompt: str) -> TextEmbedding:
        """The embedding of a prompt that contains a client's text. Refused: bad_target, perception_down, or by a worker."""
        if not 1 <= len(text) <= _MAX_TEXT_CHARS:
            raise Refused(
                "bad_target", f"say what is looked for in 1 to {_MAX_TEXT_CHARS} characters: target=… or text=…"
            )
        try:
            return self._texts.encode(prompt)
        except Refused:
            raise
        except (BusError, PerceptionError) as error:
            raise Refused(
                "perception_down", f"nothing tells what {text!r} means without perception: {error}"
            ) from error

    def build_value(self, floor: str, text: TextEmbedding) -> None:
        """Builds the value layer of a new target from all views that are kept, while the maps may change.

        KeyError: no such floor.
        """
        with self.maps.lock:
            joint = self.joint_of(floor)
            pending = joint.pending_value(floor, *text)
        if pending is not None:
            pending.build()
            with self.maps.lock:
                # not those that may have taken their place meanwhile, without the views of some source
                joint.adopt_value(floor, pending)
