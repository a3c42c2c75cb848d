"""Identities: who somebody on the bus is, by the common name of its certificate."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, get_args

from surveilnav.contract import ID
from surveilnav.errors import ConfigError

#: Kinds of identities. ``cameras`` is one identity for all replicas of a container, each of which takes a free camera;
#: ``supervisor`` is `surveilnav up`; ``viewer`` a program that only reads, and gets no pictures; ``doors``
#: a bridge to the system that opens doors and moves lifts.
Kind = Literal[
    "router",
    "fusion",
    "planner",
    "gateway",
    "recorder",
    "perception",
    "supervisor",
    "cameras",
    "camera",
    "robot",
    "viewer",
    "doors",
]
KINDS: tuple[Kind, ...] = get_args(Kind)
#: Kinds of which there is one identity for each thing: its name follows the kind, as in ``camera-lobby``.
NAMED: frozenset[Kind] = frozenset({"camera", "robot", "viewer"})
#: A camera of this name could publish on keys of the simulator's verdicts.
_RESERVED = "judged"
#: Length limit of a common name (RFC 5280, ub-common-name).
MAX_LENGTH = 64


@dataclass(frozen=True, slots=True)
class Identity:
    """Who a certificate is for. ``id``: the name of the camera, robot or viewer; empty for the other kinds."""

    kind: Kind
    id: str = ""

    @property
    def name(self) -> str:
        """The common name of its certificate, such as ``fusion`` or ``camera-lobby``."""
        return f"{self.kind}-{self.id}" if self.id else self.kind


def identity_from_name(name: str) -> Identity:
    """The identity with a common name.

    Raises:
        ConfigError: there is no such identity, or its name is too long for a certificate.
    """
    kind, _, id = name.partition("-")
    if kind not in KINDS or (kind in NAMED) != bool(id) or (id and not re.fullmatch(ID, id)):
        unnamed = ", ".join(k for k in KINDS if k not in NAMED)
        raise ConfigError(
            f"expected an identity: {unnamed}, camera-NAME, robot-NAME or viewer-NAME, where a NAME has letters, digits, "
            f"'_', '.', '-'; got {name!r:.100}"
        )
    if len(name) > MAX_LENGTH:
        raise ConfigError(
            f"the name in a certificate has at most {MAX_LENGTH} characters: give {kind} {id!r} a shorter name"
        )
    if id == _RESERVED:
        raise ConfigError(f"no identity may have the name {_RESERVED!r}: the simulator's verdicts use it")
    return Identity(kind, id)
