"""Every number of the joint maps, in metres, radians and counts. Descriptions name the source where a value is a paper's."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import (
    Field,
    ModelWrapValidatorHandler,
    PrivateAttr,
    SerializerFunctionWrapHandler,
    model_serializer,
    model_validator,
)

from surveilnav import robot_body
from surveilnav.services.fusion.core.config_part import ConfigPart
from surveilnav.services.fusion.core.maps.prior import PriorMap
from surveilnav.services.fusion.core.objects.config import (
    AssociationConfig,
    ConfirmationConfig,
    FalsePositiveConfig,
    ObjectConfig,
    PointsConfig,
)

ValueFusion = Literal["average", "confidence", "latest"]


class MapConfig(ConfigPart):
    """Point cloud, obstacle map, exploration map and frontiers of a floor."""

    #: By floor. No setting: arrays from files that the building file names.
    _priors: Mapping[str, PriorMap] = PrivateAttr(default={})

    tau_z_m: float = Field(
        default=0.4, gt=0, description="tau_z of eq. 1: a view within this of a floor's altitude belongs to that floor"
    )
    release_z_m: float = Field(
        default=0.6,
        gt=0,
        description="an active camera stays so within this of a robot's floor, against flapping while the robot is on a stair",
    )
    stair_step_m: float = Field(
        default=0.6,
        gt=0,
        description="a robot whose altitude changes by less from view to view is climbing; by more, it has been moved",
    )
    new_floor_distance_m: float = Field(
        default=1.0, gt=0, description="a robot that has moved this far at one altitude is on a floor, not on a stair"
    )
    new_floor_views: int = Field(
        default=8, ge=1, description="... or has taken this many views there, under a floor name that is new"
    )
    resolution_m: float = Field(default=0.05, gt=0, description="side of a cell of all 2D maps")
    extent_m: float = Field(default=24.0, gt=0, description="side of a new map; maps grow as needed")
    max_extent_m: float = Field(
        default=150.0,
        gt=0,
        description="views that would make a map larger are refused, since a remote pose may be anything",
    )
    max_floors: int = Field(default=64, ge=1, description="views that would make more floors are refused")
    voxel_m: float = Field(default=0.025, gt=0, description="side of a voxel of the point cloud and of objects")
    max_voxels: int = Field(
        default=2_000_000,
        ge=1,
        description="voxels of a floor's cloud; beyond it, points in new voxels are dropped and counted",
    )
    depth_noise_m: float = Field(
        default=0.01, gt=0, description="standard deviation of depth at close range, including errors of the pose"
    )
    depth_noise_per_m: float = Field(
        default=0.002, ge=0, description="added to it, times range^2 (Nguyen 2012: 0.0019)"
    )
    carve_views: int = Field(
        default=2, ge=0, le=2, description="a voxel is removed once this many newer views see through it; 0: never"
    )
    carve_margin_m: float = Field(default=0.05, ge=0, description="margin of that test, beside 3 sigma of depth noise")
    carve_memory: int = Field(
        default=64, ge=1, description="number of newest views that are kept to carve voxels which arrive late"
    )
    points_per_view: int = Field(default=20_000, ge=100, description="a view is subsampled to about this many pixels")
    max_range_robot_m: float = Field(default=5.0, gt=0, description="farther points of robots are left out")
    max_range_camera_m: float = Field(default=10.0, gt=0, description="farther points of cameras are left out")
    depth_edge: float = Field(
        default=0.05,
        gt=0,
        description="a pixel whose neighbours differ by more than this share of its depth is a flying pixel",
    )
    obstacle_min_m: float = Field(default=0.12, description="lowest height above the floor of points that block")
    obstacle_max_m: float = Field(default=1.1, description="highest height above the floor of points that block")
    obstacle_noise_per_m: float = Field(
        default=0.002,
        ge=0,
        description="raises obstacle_min_m and drop_min_m by this times range^2, for the depth noise",
    )
    drop_min_m: float = Field(
        default=0.12,
        gt=0,
        description="a floor at least this much lower is a drop, which blocks: an edge, a stair that leads down",
    )
    scan_min_hits: int = Field(default=2, ge=1, description="laser scans that must end in a cell to block it")
    scan_clear_ratio: float = Field(
        default=2.0,
        gt=0,
        description="a cell that laser scans block is free again once this many times as many pass through it",
    )
    obstacle_min_points: int = Field(default=3, ge=1, description="points that it takes to block a cell")
    clear_ratio: float = Field(
        default=6.0,
        gt=0,
        description="a cell is free again once more than this many times as many views show bare floor as an obstacle",
    )
    explored_range_camera_m: float = Field(
        default=3.0,
        gt=0,
        description="range up to which a camera explores: farther off, detectors miss most things (nine beds in ten)",
    )
    estimated_max_sigma_m: float = Field(
        default=0.6,
        gt=0,
        description="estimated obstacles that are less certain than this are left out; seen floor isn't",
    )
    estimated_clear_ratio: float = Field(
        default=1.0,
        gt=0,
        description="an estimated obstacle is free again once this many times as many estimated views show bare floor there",
    )
    value_range_without_depth_m: float = Field(
        default=5.0, gt=0, description="range up to which a view without depth counts for the value map"
    )
    explored_max_m: float = Field(default=1.2, description="rays explore only where they run below this height")
    robot_radius_m: float = Field(
        default=robot_body.RADIUS_M, ge=0, description="cells within this of where a robot stood are free"
    )
    frontier: Literal["boundary", "literal"] = Field(
        default="boundary",
        description="`boundary`: free explored cells beside unexplored ones; `literal`: dilated obstacles minus explored (paper)",
    )
    frontier_dilation_m: float = Field(
        default=0.15, ge=0, description="radius by which obstacles are dilated for frontiers"
    )
    frontier_min_cells: int = Field(default=8, ge=1, description="smaller frontiers are noise (VLN-Game)")
    frontier_hole_m2: float = Field(
        default=0.5, ge=0, description="unexplored islands smaller than this make no frontier (VLFM: 1.5)"
    )

    @model_serializer(mode="wrap")
    def _with_priors_written(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """A recording's settings hold what was known before, so that the same maps come of it wherever it is played."""
        out: dict[str, Any] = handler(self)
        if self._priors:
            out["priors"] = {floor: prior.to_text() for floor, prior in self._priors.items()}
        return out

    @model_validator(mode="wrap")
    @classmethod
    def _with_priors_read(cls, value: Any, handler: ModelWrapValidatorHandler[MapConfig]) -> MapConfig:
        if not isinstance(value, dict) or "priors" not in value:
            return handler(value)
        if not isinstance(value["priors"], dict):
            raise ValueError("expected a map for each floor that was known before")
        priors = {str(floor): PriorMap.from_text(text) for floor, text in value["priors"].items()}
        return handler({name: v for name, v in value.items() if name != "priors"}).with_priors(priors)

    def with_priors(self, priors: Mapping[str, PriorMap]) -> MapConfig:
        """A copy by which new floors begin with what is known of them, by their names."""
        copy = self.model_copy()
        copy._priors = dict(priors)
        return copy

    def prior_of(self, floor: str) -> PriorMap | None:
        return self._priors.get(floor)


class ValueConfig(ConfigPart):
    """Value map."""

    fusion: ValueFusion = Field(
        default="confidence",
        description="how values are fused: `average` is eq. 2, `confidence` is VLFM's weighted mean, `latest` keeps the newest",
    )
    min_confidence: float = Field(
        default=0.25, gt=0, le=1, description="weight at the border of the field of view; 1 in its middle (VLFM)"
    )
    max_views: int = Field(
        default=4096, ge=1, description="views that are kept for targets to come; robots' oldest are dropped first"
    )
    max_targets: int = Field(default=4, ge=1, description="targets whose value layers are kept up to date")
    half_life_s: float = Field(
        default=3600.0,
        ge=0,
        description="age behind the newest view at which a view's weight has halved; 0: it never does",
    )


class ValidationConfig(ConfigPart):
    """When a view is refused as impossible after the previous one of its source."""

    max_step_m: float = Field(
        default=2.0, gt=0, description="farthest that a robot can move between two successive observations"
    )
    climb_m: float = Field(
        default=0.4,
        gt=0,
        description="a robot whose altitude changes by more has used a stair or a lift, and may be anywhere",
    )
    max_sources: int = Field(default=100_000, ge=1, description="sources whose last view is remembered")
    floor_share: float = Field(
        default=0.1,
        ge=0,
        le=1,
        description="a camera's view with a smaller share of points on its floor is searched for mistakes; 0: never",
    )
    corrected_floor_share: float = Field(
        default=0.15, gt=0, le=1, description="... and refused if a mistake explains this share, and four times as much"
    )
    outside_storey_share: float = Field(
        default=0.15,
        gt=0,
        le=1,
        description="... or if so many points lie below its floor, more than half if they are level (a lower floor); 1: never",
    )
    max_tilt_deg: float = Field(
        default=2.5, gt=0, description="a camera by whose views the floor leans by more isn't believed"
    )
    max_height_error_m: float = Field(
        default=0.15, gt=0, description="... and one by whose views the floor lies higher or lower by more"
    )
    min_refuted_voxels: int = Field(
        default=1500, ge=1, description="a camera isn't believed if others look through so many of its voxels"
    )
    max_refuted_share: float = Field(
        default=0.08, gt=0, le=1, description="... and this share of those where others have looked, too"
    )
    compare_every_views: int = Field(
        default=8, ge=1, description="after so many views of robots, cameras are compared with them"
    )
    compare_within_s: float = Field(
        default=600.0,
        gt=0,
        description="... where these look at most so long after the camera: later, things may have been moved",
    )


class ViewOrderConfig(ConfigPart):
    """In which order camera views are perceived: by the unexplored floor that they show near robots."""

    distance_scale_m: float = Field(
        default=4.0,
        gt=0,
        description="a place at this distance from the nearest robot counts 1/e of one beside the robot",
    )
    frontier_weight: float = Field(
        default=5.0, ge=0, description="weight of a place on a frontier; an unexplored place has weight 1"
    )
    explored_weight: float = Field(default=0.05, ge=0, description="weight of an explored place")
    ray_step_m: float = Field(default=0.1, gt=0, description="distance between two places along a ray")


class EstimatedDepthConfig(ConfigPart):
    """What depth that a network estimated counts for."""

    warp_sigma: float = Field(
        default=0.06, gt=0, description="standard deviation of the depth's logarithm across a picture, beside its scale"
    )
    floor_tolerance: float = Field(
        default=0.05, gt=0, description="a pixel whose corrected depth is within this share of the floor's shows floor"
    )
    floor_peak: float = Field(
        default=0.5, gt=0, le=1, description="a factor that this share of the most pixels have may be the floor's"
    )
    min_floor_samples: int = Field(default=60, ge=10, description="pixels of about 9,000 that must show floor")
    min_floor_share: float = Field(
        default=0.1, ge=0, le=1, description="... and their share of the pixels that can; otherwise depth isn't used"
    )
    independent_samples: float = Field(
        default=200.0, gt=0, description="all pixels of a picture together tell as much as this many independent ones"
    )


class FusionConfig(ConfigPart):
    """All settings of the joint maps."""

    map: MapConfig = Field(default=MapConfig(), description="point cloud, obstacles, exploration, frontiers")
    value: ValueConfig = Field(default=ValueConfig(), description="value map")
    objects: ObjectConfig = Field(default=ObjectConfig(), description="object map")
    validation: ValidationConfig = Field(default=ValidationConfig(), description="which views are refused")
    views: ViewOrderConfig = Field(default=ViewOrderConfig(), description="in which order camera views are perceived")
    estimated_depth: EstimatedDepthConfig = Field(
        default=EstimatedDepthConfig(), description="how estimated depth is corrected by the floor"
    )

    @classmethod
    def preset(cls, name: Literal["default", "paper"]) -> FusionConfig:
        """``paper`` follows the paper to the letter (VLN-Game where it is silent); ``default`` is what works best here."""
        if name == "default":
            return cls()
        return cls(
            map=MapConfig(explored_range_camera_m=10.0),
            value=ValueConfig(fusion="average", half_life_s=0.0),
            objects=ObjectConfig(
                points=PointsConfig(max_points=10_000, dbscan_eps_pixels=0.0, min_points=20),
                association=AssociationConfig(
                    geometry="box_iou",
                    tau=1.35,
                    tau_mutual=None,
                    once_per_view=False,
                    merge_every=20,
                    merge_overlap=0.7,
                    merge_visual=0.7,
                    merge_box=None,
                ),
                confirmation=ConfirmationConfig(rule="paper"),
                false_positives=FalsePositiveConfig(size_prior=False),
            ),
        )

    def changed(self, changes: Mapping[str, Any]) -> FusionConfig:
        """A copy with the settings in ``changes``, nested as the parts are. ValidationError: an unknown name or invalid value."""
        return FusionConfig.model_validate(_merged(self.model_dump(), changes))


def _merged(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """``under``, with the values of ``over`` in place of its own, recursively."""
    both = dict(under)
    for key, value in over.items():
        nested = isinstance(value, Mapping) and isinstance(both.get(key), Mapping)
        both[key] = _merged(both[key], value) if nested else value
    return both
