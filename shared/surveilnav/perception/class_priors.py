"""What is known of classes by name: one data file, a section for each consumer.

A consumer says what its section holds with a struct of its own::

    class FusionPriors(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        recall: dict[str, float]

    PRIORS = class_priors("fusion", FusionPriors)

Classes are named as in ``surveilnav.categories``.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TypeVar

import msgspec

from surveilnav.errors import ConfigError

FILE = Path(__file__).parent / "data" / "class_priors.json"

Section = TypeVar("Section", bound=msgspec.Struct)


def class_priors(section: str, kind: type[Section], file: Path = FILE) -> Section:
    """The section of one consumer, as its own ``kind`` of struct.

    Raises:
        ConfigError: the file has no such section, or what it says isn't of that kind.
    """
    sections = _sections(file)
    if section not in sections:
        raise ConfigError(f"{file.name} has no section {section!r}; it has {', '.join(sorted(sections))}")
    try:
        return msgspec.json.decode(sections[section], type=kind)
    except msgspec.DecodeError as error:
        raise ConfigError(f"section {section!r} of {file.name} isn't what {kind.__name__} says: {error}") from error


@cache
def _sections(file: Path) -> dict[str, msgspec.Raw]:
    return msgspec.json.decode(file.read_bytes(), type=dict[str, msgspec.Raw])
