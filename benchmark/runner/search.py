"""One search as a run's settings have it, for runs, the golden run and studies."""

from __future__ import annotations

import math

from surveilnav.benchmark.play.cameras import Cameras
from surveilnav.benchmark.play.episode import Episode, EpisodeResult, FusedCameras, OnStep
from surveilnav.benchmark.play.shortest_path import ShortestPathPlanner
from surveilnav.benchmark.play.sight import NOT_MEASURED, PoseError, Sight, ViewBytes
from surveilnav.benchmark.policies import LanguageModel, Task, Truth, policy_of
from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.camera_plan import CameraPlan
from surveilnav.perception.backend import Backend
from surveilnav.services.fusion.core import FusionConfig
from surveilnav.services.planner.core.motion.drive import FmmPlanner, LocalPlanner
from surveilnav.services.planner.core.motion.waypoint_driving import WaypointPlanner
from surveilnav.simulator.simulation import SimulatedBuilding
from surveilnav.simulator.truth.choose import with_perfect_detector
from surveilnav.simulator.world.goals import Goals, Start
from surveilnav.simulator.world.navigation import NavigationMap


def sight_of(
    building: SimulatedBuilding,
    backend: Backend,
    settings: RunSettings,
    *,
    plan: CameraPlan | None = None,
    view_bytes: ViewBytes = NOT_MEASURED,
) -> Sight:
    """The eyes that ``settings`` give a run in ``building``; ``plan`` and ``view_bytes``: see ``Sight``."""
    return Sight(
        building,
        backend,
        plan=plan,
        views=settings.views,
        way="depth" if backend.needs_truth else "pixels",
        scale=settings.resolution_divisor,
        view_bytes=view_bytes,
        camera_depth=settings.camera_depth,
        camera_tier=settings.camera_tier,
        camera_backend=with_perfect_detector(backend) if settings.camera_perception else None,
        pose_error=PoseError(settings.camera_error_m, math.radians(settings.camera_error_deg)),
    )


def search(
    sight: Sight,
    settings: RunSettings,
    goals: Goals,
    start: Start,
    *,
    seed: int,
    goal_on_floor: bool = False,
    fused: FusedCameras | None = None,
    cameras: Cameras | None = None,
    on_step: OnStep | None = None,
    fusion: FusionConfig | None = None,
    language_model: LanguageModel | None = None,
) -> EpisodeResult:
    """Plays a search for ``goals.label`` from ``start``, the same whenever it is played.

    Args:
        sight: of the building that goals and start lie in, with the perception that ``settings`` name.
        seed: the luck of perception and policy.
        goal_on_floor: it begins on a floor with a goal, and the searcher is told so.
        fused, cameras, on_step: see ``Episode``.
        fusion: settings of the joint maps; None: those of ``settings``.
        language_model: for a policy that needs one.
    """
    policy, navigation = policy_of(settings.policy), sight.building.navigation
    task = Task(
        goals.label,
        seed,
        settings.max_steps,
        _driver(settings, navigation),
        Truth(goals, navigation) if policy.needs_truth else None,
        language_model,
        goal_on_floor=goal_on_floor,
        planning={"drive": settings.drive, **settings.planning},
    )
    return Episode(
        sight,
        goals,
        start,
        policy.begin(task),
        surveillance=settings.surveillance,
        fusion=fusion or settings.fusion_config(),
        fused=fused,
        delay_steps=settings.delay_steps,
        views_per_step=settings.views_per_step,
        seed=seed,
        cameras=cameras,
        on_step=on_step,
        drive=settings.drive,
        localisation=settings.localisation_error(),
    ).run()


def _driver(settings: RunSettings, navigation: NavigationMap) -> LocalPlanner:
    if settings.drive == "waypoints":
        return WaypointPlanner()
    return ShortestPathPlanner(navigation) if settings.planner == "sp" else FmmPlanner()
