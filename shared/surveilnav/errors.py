"""All errors that a user can cause.

    SurveilNavError                 the base: the command line prints its text and exits 1, no traceback
    ├── BuildingError               a building can't be found or read
    │   └── AssetError              furniture or example homes can't be found or downloaded
    ├── TargetError                 a target that can't be searched for
    ├── ConfigError                 a setting is wrong or missing
    ├── PoseError                   a camera's pose can't be found from the given points
    ├── FrameError                  where a robot's map lies in the building can't be found; has a name
    ├── MissingExtraError           a command needs packages that this installation lacks
    ├── PerceptionError             a perception backend can't run or answer
    ├── WireError                   received data that is no message of the contract
    ├── BusError                    the router can't be reached, or a port is taken
    ├── MissionError                a mission can't be accepted; has a name from the contract
    └── GatewayError                the gateway doesn't answer, or refuses; has its problem's name

Each message says what was expected, what was found instead, and what to do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pydantic import ValidationError


class SurveilNavError(Exception):
    """Base of all errors caused by the user, the network or the data, as opposed to programming errors."""


class BuildingError(SurveilNavError):
    """A building can't be found or read."""


class AssetError(BuildingError):
    """Furniture or example homes can't be found or downloaded."""


class TargetError(SurveilNavError):
    """A target that can't be searched for."""


class ConfigError(SurveilNavError):
    """A setting is wrong or missing."""


class PoseError(SurveilNavError):
    """A camera's pose can't be found from the given points; the text says which points to add or to correct.

    ``points``: the numbers, from 1, of those that it says are wrong.
    """

    def __init__(self, message: str, points: Sequence[int] = ()) -> None:
        super().__init__(message)
        self.points = tuple(points)


class FrameError(SurveilNavError):
    """Where a robot's map lies in the building can't be found. The text says what to add or to correct.

    Names:
        undetermined: what is given fits at many places.
        contradictory: what is given contradicts itself.
        mirrored: the pairs would fit if one of the frames were seen in a mirror.
        ambiguous: the map fits at two places about equally well.
        too_little_overlap: both maps show too little of the same part of the building.
        no_match: the map fits nowhere.

    Attributes:
        name: one of these.
        pairs: the numbers, from 1, of the pairs or stops that the text says are wrong.
    """

    def __init__(self, name: str, message: str, pairs: Sequence[int] = ()) -> None:
        super().__init__(message)
        self.name, self.pairs = name, tuple(pairs)


class MissingExtraError(SurveilNavError):
    """A command needs packages that this installation lacks; the text names the extra that brings them."""


class PerceptionError(SurveilNavError):
    """A perception backend can't run or can't answer."""


class WireError(SurveilNavError):
    """Received data that is no valid message of the contract."""


class BusError(SurveilNavError):
    """The router can't be reached, or a port is taken."""


class NameTakenError(BusError):
    """Another process has the name that a node wants on the bus."""


class MissionError(SurveilNavError):
    """A mission can't be accepted. ``name`` is one of the contract's failure names."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


class GatewayError(SurveilNavError):
    """The gateway doesn't answer, or refuses. ``name``: the last part of its problem's type."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


def explain_settings_error(error: ValidationError) -> str:
    """What is wrong with settings, a line for each fault: the setting, what was expected, what arrived."""
    lines = []
    for fault in error.errors():
        name = ".".join(str(part) for part in fault["loc"])
        lines.append(f"error: setting {error.title}.{name}: {fault['msg']}, got {fault.get('input')!r}")
    return "\n".join(lines)
