"""What a run is: everything that its numbers depend on."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Literal

import msgspec
from pydantic import TypeAdapter, ValidationError

from benchmark.policies import policy_of
from services.fusion.core import FusionConfig
from services.planner.core import PlannerConfig
from simulator.truth.choose import BACKENDS
from surveilnav.errors import ConfigError
from surveilnav.perception.weights import WEIGHTS

_PLANNING = TypeAdapter(PlannerConfig)


class RunSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The same settings on the same dataset give the same table.

    Attributes:
        density_m2: square metres of floor for a camera; one of the dataset's.
        views: ``panoramic`` or ``half``, the six neighbouring azimuths that see most.
        seed: sets the luck of perception and policies.
        resolution_divisor: of depth, where perception looks at no pixel.
        harder: of ``simulated``: a worse detector than the measured one, in standard deviations of its luck.
        delay_steps: so many actions after its invocation a camera's views arrive.
        camera_error_m, camera_error_deg: how wrong each camera is about where it hangs and looks.
        detectors: the weights of ``onnx-coco``; empty: its own choice.
        fusion, planning: settings of the joint maps and of the planner's core to change, by name.
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
    harder: float = 0.0
    delay_steps: int = 0
    camera_error_m: float = 0.0
    camera_error_deg: float = 0.0
    detectors: list[str] = []
    fusion: dict[str, Any] = {}
    planning: dict[str, Any] = {}

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
        if not (self.delay_steps >= 0 and self.camera_error_m >= 0.0 and self.camera_error_deg >= 0.0):
            raise ConfigError(
                f"delay and errors are 0 or more, got {self.delay_steps} steps, {self.camera_error_m} m, "
                f"{self.camera_error_deg} degrees"
            )
        self.fusion_config()
        known = {f.name for f in fields(PlannerConfig)}
        if unknown := sorted(set(self.planning) - known):
            raise ConfigError(f"the planner has no setting {unknown[0]!r}; it has {', '.join(sorted(known))}")
        try:
            _PLANNING.validate_python(self.planning)
        except ValidationError as error:
            raise ConfigError(f"these settings of the planner can't be: {error}") from error
        if unknown := sorted(set(self.detectors) - set(WEIGHTS)):
            raise ConfigError(f"detectors are of {', '.join(WEIGHTS)}, got {unknown[0]!r}")

    def fusion_config(self) -> FusionConfig:
        """The policy's joint maps with what is to be changed. ConfigError: a setting that doesn't exist or can't be."""
        try:
            return policy_of(self.policy).fusion.changed(self.fusion)
        except ValidationError as error:
            raise ConfigError(f"these settings of the joint maps can't be: {error}") from error
