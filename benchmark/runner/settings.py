"""What a run is: everything that its numbers depend on."""

from __future__ import annotations

from typing import Literal

import msgspec

from benchmark.policies import policy_of
from surveilnav.errors import ConfigError
from surveilnav.perception.choose import BACKENDS


class RunSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The same settings on the same dataset give the same table.

    Attributes:
        density_m2: square metres of floor for a camera; one of the dataset's.
        views: ``panoramic`` or ``half``, the six neighbouring azimuths that see most.
        seed: sets the luck of perception and policies.
        resolution_divisor: of depth, where perception looks at no pixel.
    """

    split: str = "val_mini"
    policy: str = "surveilnav"
    planner: Literal["fmm", "sp"] = "fmm"
    surveillance: bool = True
    perception: str = "simulated"
    density_m2: int = 100
    views: Literal["panoramic", "half"] = "panoramic"
    max_steps: int = 500
    seed: int = 0
    resolution_divisor: int = 2

    def check(self) -> None:
        """ConfigError: a name that doesn't exist; the message lists what does."""
        policy_of(self.policy)
        real = tuple(b for b in BACKENDS if b != "auto")  # a table must say what looked
        if self.perception not in real:
            raise ConfigError(f"perception is one of {', '.join(real)}, got {self.perception!r}")
        if not 1 <= self.max_steps <= 5000:
            raise ConfigError(f"an episode has 1 to 5000 steps, got {self.max_steps}")
        if not 1 <= self.resolution_divisor <= 8:
            raise ConfigError(f"the resolution is divided by 1 to 8, got {self.resolution_divisor}")
