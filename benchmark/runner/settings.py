"""What a run is: everything that its numbers depend on."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Any, Literal, get_args

import msgspec
from pydantic import ValidationError

from surveilnav.benchmark.play.motion import Drive, LocalisationError
from surveilnav.benchmark.play.sight import CameraDepth, Views
from surveilnav.benchmark.policies import policy_of
from surveilnav.benchmark.policies.language_model import LanguageModelSettings
from surveilnav.errors import ConfigError
from surveilnav.messages import Tier
from surveilnav.perception.models import COCO_DETECTORS
from surveilnav.perception.names import BackendName
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core import PlannerConfig
from surveilnav.simulator.truth.choose import BACKENDS

Planner = Literal["fmm", "sp"]


class RunSettings(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The same settings on the same dataset give the same table.

    Attributes:
        camera_perception: ``oracle``: what the cameras see is told by the truth, as if ``perception`` had a perfect detector
            there; the robot has ``perception`` as it is. That is a bound, no method. Empty: cameras have ``perception``, too.
        density_m2: square metres of floor for a camera; one of the dataset's.
        views: ``panoramic`` or ``half``, the six neighbouring azimuths that see most.
        drive: ``actions``: Habitat's robot; ``waypoints``: one that drives to poses by itself, as with Nav2.
        localisation: of ``waypoints``: how wrong the robot is about where it is, see ``play.motion.LocalisationError``.
        seed: sets the luck of perception and policies.
        resolution_divisor: of depth, where perception looks at no pixel.
        harder: of ``simulated``: a worse detector than the measured one, in standard deviations of its luck.
        delay_steps: so many actions after its invocation a camera's views arrive.
        views_per_step: how many camera views are looked at between two actions, as measured in the running system on two
            cores; 0: all of them before the first action.
        camera_depth: ``sensor``: with a sensor's noise; ``network``: estimated by our depth network; ``none``: cameras have no
            depth; ``estimate-5``, ``estimate-15``: estimated, with an error of so many percent (``play.depth_error``).
        camera_tier: how much the cameras send of their views (``surveilnav.sensing.tiers``), where perception looks at pixels.
        camera_error_m, camera_error_deg: how wrong each camera is about where it hangs and looks.
        detectors: the weights of ``onnx-coco``; empty: its own choice.
        language_model: the name of the model that a policy asks, as its server knows it; where that is, the environment says.
        fusion, planning: settings of the joint maps and of the planner's core to change, by name.
    """

    split: str = "val_mini"
    policy: str = "surveilnav"
    planner: Planner = "fmm"
    surveillance: bool = True
    perception: str = "simulated"
    camera_perception: Literal["", "oracle"] = ""
    density_m2: int = 100
    views: Views = "panoramic"
    drive: Drive = "actions"
    localisation: dict[str, float] = {}
    max_steps: int = 500
    seed: int = 0
    resolution_divisor: int = 2
    harder: float = 0.0
    delay_steps: int = 0
    views_per_step: int = 2
    camera_depth: CameraDepth = "sensor"
    camera_tier: Tier = "jpeg+depth"
    camera_error_m: float = 0.0
    camera_error_deg: float = 0.0
    detectors: list[str] = []
    language_model: str = ""
    fusion: dict[str, Any] = {}
    planning: dict[str, Any] = {}

    def check(self) -> None:
        """ConfigError: a name or value that can't be; the message lists what can."""
        self._check_language_model()
        _expect("planner", self.planner, get_args(Planner))
        _expect("views", self.views, get_args(Views))
        _expect("drive", self.drive, get_args(Drive))
        self.localisation_error()
        _expect("camera_depth", self.camera_depth, get_args(CameraDepth))
        _expect("camera_tier", self.camera_tier, get_args(Tier))
        _expect("perception", self.perception, [b for b in BACKENDS if b != "auto"])  # a table must say what looked
        if self.camera_tier != "jpeg+depth" and BackendName(self.perception).is_told:
            raise ConfigError(
                f"{self.perception} looks at no pictures, so cameras send none: leave camera_tier as it is"
            )
        _expect("camera_perception", self.camera_perception, ("", "oracle"))
        if self.camera_perception and not self.surveillance:
            raise ConfigError("camera_perception says how cameras see, but none take part: surveillance is off")
        for detector in self.detectors:
            _expect("each of detectors", detector, list(COCO_DETECTORS))
        if not 1 <= self.max_steps <= 5000:
            raise ConfigError(f"an episode has 1 to 5000 steps, got {self.max_steps}")
        if not 1 <= self.resolution_divisor <= 8:
            raise ConfigError(f"the resolution is divided by 1 to 8, got {self.resolution_divisor}")
        if min(self.delay_steps, self.views_per_step, self.camera_error_m, self.camera_error_deg) < 0.0:
            raise ConfigError(
                f"delay, views and errors are 0 or more, got {self.delay_steps} steps, {self.views_per_step} views, "
                f"{self.camera_error_m} m, {self.camera_error_deg} degrees"
            )
        self.fusion_config()
        try:
            PlannerConfig(**self.planning)
        except ValidationError as error:
            raise ConfigError(f"these settings of the planner can't be: {error}") from error

    def _check_language_model(self) -> None:
        if not policy_of(self.policy).needs_language_model:
            if self.language_model:
                raise ConfigError(
                    f"the policy {self.policy!r} asks no language model: leave out {self.language_model!r}"
                )
            return
        if not self.language_model:
            raise ConfigError(
                f"the policy {self.policy!r} asks a language model: say which by --language-model, with the name that its "
                "server has for it"
            )
        LanguageModelSettings.of_environment()

    def localisation_error(self) -> LocalisationError:
        """ConfigError: an error that doesn't exist, or on a robot of actions, which knows where it is."""
        if self.localisation and self.drive != "waypoints":
            raise ConfigError("only a robot that drives to waypoints has a localisation: drive is waypoints")
        try:
            return msgspec.convert(self.localisation, LocalisationError)
        except msgspec.ValidationError as error:
            raise ConfigError(f"this error of localisation can't be: {error}") from None

    def fusion_config(self) -> FusionConfig:
        """The policy's joint maps with what is to be changed. ConfigError: a setting that doesn't exist or can't be."""
        try:
            return policy_of(self.policy).fusion.changed(self.fusion)
        except ValidationError as error:
            raise ConfigError(f"these settings of the joint maps can't be: {error}") from error


def run_id(settings: RunSettings) -> str:
    """A run's name: its split, and a hash of what differs from the defaults. Runs with the same settings share it."""
    default = msgspec.to_builtins(RunSettings())
    said = {k: v for k, v in msgspec.to_builtins(settings).items() if v != default[k] and k != "split"}
    text = msgspec.json.encode(said, order="sorted")
    return f"{settings.split.replace('/', '_')}-{hashlib.sha256(text).hexdigest()[:8]}"


def _expect(name: str, value: str, known: Sequence[str]) -> None:
    if value not in known:
        raise ConfigError(f"{name} is one of {', '.join(known)}, got {value!r}")
