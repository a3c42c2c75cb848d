"""Every error a user can cause.

    SurveilNavError                 the base: the command line prints its text and exits 1, no traceback
    ├── BuildingError               a building can't be found or read
    │   └── AssetError              furniture or example homes can't be had
    ├── TargetError                 a target name nobody can search for
    ├── ConfigError                 a setting is wrong or missing
    ├── MissingExtraError           a command needs packages that this installation lacks
    ├── PerceptionError             a perception backend can't run or answer
    ├── WireError                   bytes that are no message of the contract
    ├── BusError                    the router can't be reached, or a port is taken
    ├── MissionError                a mission can't be accepted; carries a name from the contract
    └── GatewayError                the gateway doesn't answer, or refuses; carries its problem's name

Each message says what was expected, what arrived, and what to do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError


class SurveilNavError(Exception):
    """The base of all errors that are the user's, the network's or the data's, not the programmer's."""


class BuildingError(SurveilNavError):
    """A building can't be found or read."""


class AssetError(BuildingError):
    """Furniture or example homes can't be had."""


class TargetError(SurveilNavError):
    """A target name that nobody can search for."""


class ConfigError(SurveilNavError):
    """A setting is wrong or missing."""


class MissingExtraError(SurveilNavError):
    """A command needs packages that this installation lacks; the text names the extra that brings them."""


class PerceptionError(SurveilNavError):
    """A perception backend can't run or can't answer."""


class WireError(SurveilNavError):
    """Bytes that are no message of the contract: wrong schema, wrong version, or undecodable."""


class BusError(SurveilNavError):
    """The router can't be reached, or a port is taken."""


class MissionError(SurveilNavError):
    """A mission can't be accepted. ``name`` is one of the contract's failure names."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


class GatewayError(SurveilNavError):
    """The gateway doesn't answer, or refuses. ``name`` ends the type of its problem."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


def explain_settings(error: ValidationError) -> str:
    """What is wrong with settings, a line for each fault: the setting, what was expected, what arrived."""
    lines = []
    for fault in error.errors():
        name = ".".join(str(part) for part in fault["loc"])
        lines.append(f"error: setting {error.title}.{name}: {fault['msg']}, got {fault.get('input')!r}")
    return "\n".join(lines)
