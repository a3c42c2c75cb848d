"""What all answers about the maps share: the maps of a floor, and what words mean."""

from __future__ import annotations

from surveilnav.bus import Refused
from surveilnav.errors import BusError, PerceptionError
from surveilnav.services.fusion.building_maps import BuildingMaps
from surveilnav.services.fusion.core import JointMap
from surveilnav.services.fusion.intake.robot_places import RobotPlaces
from surveilnav.services.fusion.intake.texts import TextEmbedding, TextEncoder

_MAX_TEXT_CHARS = 200


class MapReader:
    """Reads the maps for the threads that answer queries."""

    def __init__(self, maps: BuildingMaps, texts: TextEncoder, places: RobotPlaces) -> None:
        self.maps = maps
        self._texts, self._places = texts, places

    def joint_of(self, floor: str) -> JointMap:
        """The joint maps for questions about a floor. The caller holds ``maps.lock``.

        Where a robot stands on a floor whose views were all refused, these are empty maps of that floor.
        """
        joint, place = self.maps.joint, self._places.on(floor)
        processed = any(last.floor == floor for last in list(self.maps.processed.robots.values()))
        if joint.knows(floor) or place is None or not processed:
            return joint
        return JointMap.unseen(floor, place.z_m, (place.x_m, place.y_m), joint.config)

    def embedding(self, said: str, prompt: str) -> TextEmbedding:
        """The embedding of a prompt that contains what somebody said. Refused: bad_target, perception_down, or by a worker."""
        if not 1 <= len(said) <= _MAX_TEXT_CHARS:
            raise Refused(
                "bad_target", f"say what is looked for in 1 to {_MAX_TEXT_CHARS} characters: target=… or text=…"
            )
        try:
            return self._texts.encode(prompt)
        except Refused:
            raise
        except (BusError, PerceptionError) as error:
            raise Refused(
                "perception_down", f"nothing tells what {said!r} means without perception: {error}"
            ) from error

    def build_value(self, floor: str, text: TextEmbedding) -> None:
        """Makes the value layer of a new target ready, which takes every view that is kept, while the maps go on.

        KeyError: no such floor.
        """
        with self.maps.lock:
            pending = self.joint_of(floor).pending_value(floor, *text)
        if pending is not None:
            pending.build()
            with self.maps.lock:
                self.joint_of(floor).adopt_value(floor, pending)
