"""A simulated building as its nodes use it: its settings, and one object that makes each part on demand, from caches if it can.

``prepare`` is the one-shot step: it bakes the light, places the cameras and renders their views into the
cache. After it a camera node needs only the ``CameraPlan`` and the cached views, not the building.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import msgspec
from pydantic import Field
from pydantic_settings import BaseSettings, SettingsConfigDict

from surveilnav import __version__
from surveilnav.camera_plan import CameraPlan, PlannedCamera
from surveilnav.code_fingerprint import code_fingerprint
from surveilnav.config import cache_dir
from surveilnav.geometry import Matrix4, Pinhole, Pose
from surveilnav.simulator.render.depth_noise import DepthNoise
from surveilnav.simulator.render.view_cache import ViewCache
from surveilnav.storage import read_parts, write_parts

if TYPE_CHECKING:
    from surveilnav.simulator.render.picture import Rendered
    from surveilnav.simulator.render.renderer import Renderer
    from surveilnav.simulator.world.cameras import PlacedCamera
    from surveilnav.simulator.world.navigation import NavigationMap
    from surveilnav.simulator.world.raycast import RayCaster
    from surveilnav.simulator.world.reach import Reach
    from surveilnav.simulator.world.scene import Scene

Progress = Callable[[float, str], None]

#: What a surveillance camera measures: its depth covers a large room.
CAMERA_DEPTH_RANGE_M = (0.3, 10.0)
_VIEW_CACHE_BYTES = 8_000_000_000
_PLAN_FORMAT = b"surveilnav plan 3"


class SimulationSettings(BaseSettings):
    """Which building is simulated, and how. Every field is an environment variable ``SURVEILNAV_SIM__<FIELD>``."""

    model_config = SettingsConfigDict(env_prefix="SURVEILNAV_SIM__", extra="ignore")

    building: str = Field(
        "studio",
        description="a name of `surveilnav buildings`, or the path of a .sh3d file, a Home.xml, a .glb, an .obj or a folder of "
        "HM3D",
    )
    seed: int = Field(0, ge=0, description="chooses furniture models, floor textures, starts and sensor noise")
    models: Literal["all", "train", "val"] = Field(
        "all", description="furnish with all models, or only with one half of them, as the benchmark's train and val do"
    )
    area_per_camera_m2: float = Field(
        100.0, gt=0, description="one camera is placed for this many square metres of floor"
    )
    cameras: int | None = Field(
        None,
        ge=0,
        le=10_000,
        description="place this many cameras in the building; not set: one for each area_per_camera_m2",
    )
    cameras_everywhere: bool = Field(False, description="place cameras also on floors that robots can't reach")
    depth_noise: bool = Field(
        True,
        description="add noise to depth; depth without noise compresses too well, so bandwidth comes out too low",
    )
    lighting: str = Field(
        "baked",
        pattern="baked|flat|shadowed",
        description="baked: light computed once and cached; flat: no light; shadowed: shadow rays for every view",
    )


class SimulatedBuilding:
    """Scene, navigation, renderer and cameras of one building, each made when first needed."""

    def __init__(self, settings: SimulationSettings, progress: Progress | None = None) -> None:
        self.settings = settings
        self._progress = progress or (lambda fraction, what: None)
        self._cache_dir = cache_dir()
        self.views = ViewCache(self._cache_dir, _VIEW_CACHE_BYTES)

    @cached_property
    def scene(self) -> Scene:
        from surveilnav.simulator.sources import open_building

        self._progress(0.0, "loading the building")
        settings = self.settings
        return open_building(settings.building, seed=settings.seed, models=settings.models, cache_dir=self._cache_dir)

    @cached_property
    def caster(self) -> RayCaster:
        from surveilnav.simulator.world.raycast import RayCaster

        return RayCaster(self.scene)

    @cached_property
    def navigation(self) -> NavigationMap:
        from surveilnav.simulator.world.navigation import NavigationMap

        return NavigationMap.load_or_build(self.scene, self._cache_dir)

    @cached_property
    def reach(self) -> Reach:
        """How much of the building robots can reach, and what keeps them from the rest."""
        from surveilnav.simulator.world.reach import reach_of

        return reach_of(self.scene, self.navigation)

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """Notes that people should read before they search the building; the first says what robots can't reach."""
        return tuple(note for note in (self.reach.sentence, *self.scene.notes) if note)

    @cached_property
    def renderer(self) -> Renderer:
        from surveilnav.simulator.render.renderer import Renderer

        lighting = self.settings.lighting
        return Renderer(self.scene, lighting=lighting, cache_dir=self._cache_dir, progress=self._progress)  # type: ignore[arg-type]

    @cached_property
    def plan(self) -> CameraPlan:
        """The camera plan, from the cache if it was made before.

        A plan of another scene (the importer changed, say) is made anew; whether it is can be told only once the
        scene is loaded, which ``prepare`` does.
        """
        path = self._plan_path()
        parts = read_parts(path, _PLAN_FORMAT)
        plan = msgspec.json.decode(parts[0], type=CameraPlan) if parts else None
        if plan is None or ("scene" in vars(self) and plan.scene_hash != self.scene.content_hash):
            plan = self.plan_with(self.settings.area_per_camera_m2, self.settings.cameras)
            write_parts(path, _PLAN_FORMAT, [msgspec.json.encode(plan)])
        return plan

    def _plan_path(self) -> Path:
        """Named by everything that the plan depends on; a home of the user's own by its content."""
        source = Path(self.settings.building)
        content = hashlib.sha256(source.read_bytes()).hexdigest() if source.is_file() else ""
        facts = self.settings.model_dump(exclude={"depth_noise", "lighting"})
        key = json.dumps([__version__, facts, content], sort_keys=True)
        return self._cache_dir / "plans" / f"{hashlib.sha256(key.encode()).hexdigest()[:32]}.plan"

    def plan_with(self, area_per_camera_m2: float, count: int | None = None) -> CameraPlan:
        """The plan of another density or number of cameras, made anew."""
        from surveilnav.simulator.world import cameras as placement

        placed: tuple[PlacedCamera, ...] = placement.place_cameras(
            self.scene,
            self.navigation,
            area_per_camera_m2=area_per_camera_m2,
            count=count,
            seed=self.settings.seed,
            caster=self.caster,
            everywhere=self.settings.cameras_everywhere,
        )
        return CameraPlan(
            self.scene.name,
            self.scene.content_hash,
            list(self.navigation.floors),
            placement.MOUNTING_M,
            placement.CAMERA,
            [
                PlannedCamera(c.name, c.floor, c.position_m, [Pose.from_matrix(T) for T in c.views], c.half())
                for c in placed
            ],
        )

    def camera_view(self, camera: PlannedCamera, view: int) -> Rendered:
        """What a surveillance camera sees, from the cache if it was rendered before."""
        noise = DepthNoise.camera() if self.settings.depth_noise else None
        return self.views.get_or_render(
            lambda: self.renderer,
            self.plan.scene_hash,
            camera.views[view].matrix(),
            self.plan.intrinsics,
            lighting=self.settings.lighting,  # type: ignore[arg-type]
            depth_range_m=CAMERA_DEPTH_RANGE_M,
            noise=noise,
            seed=noise_seed(self.settings.seed, camera.name, view),
        )

    def camera_content(self, camera: PlannedCamera, view: int) -> str:
        """A hash of all that ``camera_view`` and its instances depend on, this program among it."""
        clean = self.views.key_of(
            self.plan.scene_hash,
            camera.views[view].matrix(),
            self.plan.intrinsics,
            self.settings.lighting,  # type: ignore[arg-type]
        )
        noise = repr(DepthNoise.camera()) if self.settings.depth_noise else ""
        seed = noise_seed(self.settings.seed, camera.name, view)
        facts = clean, noise, seed, CAMERA_DEPTH_RANGE_M, code_fingerprint("surveilnav.simulator.render")
        return hashlib.sha256(repr(facts).encode()).hexdigest()

    def robot_view(
        self, T_world_camera: Matrix4, camera: Pinhole, depth_range_m: tuple[float, float], seq: int
    ) -> Rendered:
        """What a robot sees at ``T_world_camera``."""
        noise = DepthNoise.robot() if self.settings.depth_noise else None
        seed = noise_seed(self.settings.seed, "robot", seq)
        return self.renderer.render(T_world_camera, camera, depth_range_m=depth_range_m, noise=noise, seed=seed)

    def prepare(self) -> CameraPlan:
        """Makes everything that is made once: light, plan, camera views."""
        _ = self.scene  # a cached plan is compared with it
        plan = self.plan
        total = max(1, sum(len(c.views) for c in plan.cameras))
        done = 0
        for camera in plan.cameras:
            for view in range(len(camera.views)):
                self._progress(done / total, f"rendering camera views ({camera.name})")
                self.camera_view(camera, view)
                done += 1
        _ = self.renderer, self.navigation
        self._progress(1.0, "the building is ready")
        return plan


def noise_seed(seed: int, *names: object) -> int:
    """A seed of its own for every picture, the same on every machine."""
    digest = hashlib.sha256(repr((seed, *names)).encode()).digest()
    return int.from_bytes(digest[:8], "little") >> 1
