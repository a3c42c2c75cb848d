"""Every number of the joint maps. Metres, radians, counts; where it says so, the paper's or a peer's value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from surveilnav import robot_body

GeometricSimilarity = Literal["box_iou", "voxel_iou", "overlap"]
ValueFusion = Literal["average", "confidence", "latest"]


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class MapConfig(_Part):
    """Point cloud, obstacle map, exploration map and frontiers of a floor."""

    tau_z_m: float = Field(default=0.4, gt=0, description="eq. 1: a view this near to a floor's altitude belongs to it")
    release_z_m: float = Field(
        default=0.6, gt=0, description="an active camera stays so within this, so that a robot on a stair doesn't flap"
    )
    stair_step_m: float = Field(
        default=0.6, gt=0, description="a robot whose altitude changes by less a view is climbing; by more, it arrived"
    )
    level_m: float = Field(
        default=1.0, gt=0, description="a robot that went so far on one level isn't on a stair but on a floor"
    )
    level_views: int = Field(default=8, ge=1, description="... or looked so often from it, under a new floor name")
    resolution_m: float = Field(default=0.05, gt=0, description="side of a cell of all 2D maps")
    extent_m: float = Field(default=24.0, gt=0, description="side of a new map; maps grow")
    max_extent_m: float = Field(
        default=150.0, gt=0, description="a map never grows past this: remote poses are hostile"
    )
    max_floors: int = Field(default=64, ge=1, description="a view that would make one more is refused")
    voxel_m: float = Field(default=0.025, gt=0, description="side of a voxel of the point cloud and of objects")
    max_voxels: int = Field(
        default=2_000_000, ge=1, description="of a floor's cloud; beyond it new voxels are counted, not kept"
    )
    depth_noise_m: float = Field(default=0.01, gt=0, description="standard deviation of depth near by, poses included")
    depth_noise_per_m: float = Field(
        default=0.002, ge=0, description="... and what it grows by, times range^2 (Nguyen 2012: 0.0019)"
    )
    carve_views: int = Field(
        default=2, ge=0, le=2, description="what so many newer views see through is gone; 0: nothing ever is"
    )
    carve_margin_m: float = Field(default=0.05, ge=0, description="beside 3 sigma of depth noise")
    carve_memory: int = Field(default=64, ge=1, description="newest views that late voxels are checked against")
    points_per_view: int = Field(default=20_000, ge=100, description="pixels are subsampled to about this many")
    max_range_robot_m: float = Field(default=5.0, gt=0, description="farther points of robots are left out")
    max_range_camera_m: float = Field(default=10.0, gt=0, description="farther points of cameras are left out")
    depth_edge: float = Field(
        default=0.05, gt=0, description="a pixel whose neighbours differ by more than this share is a flying one"
    )
    obstacle_min_m: float = Field(default=0.12, description="lowest height above the floor that blocks")
    obstacle_max_m: float = Field(default=1.1, description="highest height above the floor that blocks")
    obstacle_noise_per_m: float = Field(
        default=0.002, ge=0, description="raises obstacle_min_m and drop_min_m by this times range^2: depth noise"
    )
    drop_min_m: float = Field(
        default=0.12, gt=0, description="least depth below the floor that blocks: an edge, a stair that leads down"
    )
    obstacle_min_points: int = Field(default=3, ge=1, description="fewer points don't block a cell")
    clear_ratio: float = Field(
        default=6.0, gt=0, description="a cell seen as bare floor in more than this many times as many views is free"
    )
    explored_range_camera_m: float = Field(
        default=3.0,
        gt=0,
        description="what a camera sees farther off isn't explored: detectors miss most of what is there (one bed in ten)",
    )
    explored_max_m: float = Field(default=1.2, description="rays explore only where they run below this height")
    robot_radius_m: float = Field(default=robot_body.RADIUS_M, ge=0, description="where a robot stands is free")
    frontier: Literal["boundary", "literal"] = Field(
        default="boundary", description="of explored free space; `literal`: dilated obstacles minus what is explored"
    )
    frontier_dilation_m: float = Field(default=0.15, ge=0, description="obstacles are dilated by this first")
    frontier_min_cells: int = Field(default=8, ge=1, description="VLN-Game: smaller components are noise")
    frontier_hole_m2: float = Field(
        default=0.5, ge=0, description="unexplored islands smaller than this are no frontier (VLFM: 1.5)"
    )


class ValueConfig(_Part):
    """Value map."""

    fusion: ValueFusion = Field(
        default="confidence", description="eq. 2 is `average`; `confidence` is VLFM's stronger variant"
    )
    min_confidence: float = Field(
        default=0.25, gt=0, le=1, description="VLFM: weight at the border of the field of view"
    )
    max_views: int = Field(default=4096, ge=1, description="robot views kept for later targets; the oldest go first")
    max_targets: int = Field(default=4, ge=1, description="layers kept up to date at once")
    half_life_s: float = Field(
        default=3600.0, ge=0, description="a view's weight halves with every such age behind the newest; 0: never"
    )


class ValidationConfig(_Part):
    """When a view of a source is refused as impossible after its previous one."""

    max_step_m: float = Field(
        default=2.0, gt=0, description="a robot moves no farther from one observation to the next"
    )
    climb_m: float = Field(default=0.4, gt=0, description="a change of altitude beyond this is a stair or a lift")
    max_sources: int = Field(default=100_000, ge=1, description="views of sources that are remembered")


class ViewOrderConfig(_Part):
    """Which camera views are looked at first."""

    near_m: float = Field(default=4.0, gt=0, description="so far from a robot a place counts 1/e of one beside it")
    frontier: float = Field(default=5.0, ge=0, description="what a frontier counts, where an unexplored place counts 1")
    known: float = Field(default=0.05, ge=0, description="what an explored place counts")
    step_m: float = Field(default=0.1, gt=0, description="between two places on a ray")


class PointsConfig(_Part):
    """From a detection's mask to points in the world."""

    max_points: int = Field(default=1000, ge=20, description="pixels of a mask that are back-projected")
    max_range_robot_m: float = Field(default=5.0, gt=0, description="farther points of robots are left out")
    max_range_camera_m: float = Field(default=8.0, gt=0, description="farther points of cameras are left out")
    dbscan_eps_m: float = Field(default=0.05, gt=0, description="points within this distance are of one cluster")
    dbscan_min_points: int = Field(default=10, ge=1, description="neighbours that a point of a cluster's core has")
    dbscan_eps_pixels: float = Field(
        default=3.0, ge=0, description="eps is at least so many sample distances; 0: the paper's fixed eps"
    )
    min_points: int = Field(default=12, ge=1, description="smaller clusters are dropped")
    min_score: float = Field(default=0.25, ge=0, le=1, description="weaker detections are not looked at")


class AssociationConfig(_Part):
    """Which object a detection belongs to (eq. 3), and which objects are one."""

    geometry: GeometricSimilarity = Field(
        default="overlap", description="S_geo: IoU of boxes, IoU of voxels (the paper), or ConceptGraphs' overlap"
    )
    w_visual: float = Field(default=1.0, ge=0, description="w_1 of eq. 3, of the embeddings' cosine")
    w_geometric: float = Field(default=1.0, ge=0, description="w_2 of eq. 3, of S_geo")
    tau: float = Field(
        default=1.3,
        description="for overlap, measured on six homes (ConceptGraphs: 1.2); the paper's 1.35 is for box_iou",
    )
    tau_mutual: float | None = Field(
        default=0.3, ge=0, le=1, description="overlap both ways that makes one object of two whatever their looks"
    )
    overlap_voxel_m: float = Field(default=0.05, gt=0, description="points within one such voxel of each other overlap")
    once_per_view: bool = Field(
        default=True, description="an object takes one detection of a class from a picture; False: eq. 3 to the letter"
    )
    merge_every: int | None = Field(
        default=5, ge=1, description="views between two searches for duplicates; None: never"
    )
    merge_overlap: float = Field(default=0.6, ge=0, description="overlap that merges objects that look alike")
    merge_box: float | None = Field(
        default=0.5, ge=0, le=1, description="share of the smaller box inside the larger that does so, too"
    )
    merge_visual: float = Field(default=0.55, ge=-1, description="cosine from which two objects look alike")


class PaperConfirmationConfig(_Part):
    """``PaperConfirmation``: a threshold on the maximum of both confidences."""

    min_confidence: float = Field(default=0.5, ge=0, le=1, description="threshold from which an object is confirmed")
    min_detections: int = Field(
        default=2, ge=1, description="of the class; with fewer an object stays a candidate (ConceptGraphs, VLN-Game)"
    )
    hysteresis: float = Field(
        default=0.8, ge=0, le=1, description="share of the threshold that keeps an object confirmed"
    )
    flip_rejects: bool = Field(default=True, description="an object whose class changes is rejected for good")


class PosteriorConfig(_Part):
    """``PosteriorConfirmation``: how likely an object is of a class (``posterior``), and one threshold for all words."""

    again: float = Field(default=1.7, ge=1, description="odds of a class are multiplied by it when a view repeats it")
    missed: float = Field(
        default=0.45, gt=0, le=1, description="... and by it when a view calls it something else, or doesn't show it"
    )
    alike: float = Field(
        default=0.4, ge=0, le=1, description="how alike views err: correlation of their evidence, and of directions'"
    )
    min_chance: float = Field(default=0.85, gt=0, le=1, description="from which an object is confirmed")
    hysteresis: float = Field(default=0.95, ge=0, le=1, description="share of it that keeps an object confirmed")
    reject_chance: float = Field(
        default=0.05, ge=0, le=1, description="below which an object is rejected that a robot missed"
    )


class ConfirmationConfig(_Part):
    """Which rule turns candidates into confirmed objects, and the settings of either."""

    rule: Literal["posterior", "paper"] = Field(
        default="posterior", description="ours, or the paper's section on joint object confirmation to the letter"
    )
    posterior: PosteriorConfig = Field(default=PosteriorConfig(), description="settings of the rule `posterior`")
    paper: PaperConfirmationConfig = Field(
        default=PaperConfirmationConfig(), description="settings of the rule `paper`"
    )


class FalsePositiveConfig(_Part):
    """What speaks against an object. The rule ``paper`` uses only the sizes of it, and that only if told to."""

    miss_near_m: float = Field(default=0.7, ge=0, description="a nearer object may miss from a picture")
    miss_far_m: float = Field(default=3.5, gt=0, description="... and so may a farther one")
    miss_visible: float = Field(
        default=0.7, ge=0, le=1, description="share of an object's points that must be in plain view"
    )
    size_prior: bool = Field(default=True, description="only what has a size that its class can have is confirmed")
    misfit_factor: float = Field(
        default=0.7, ge=0, le=1, description="what is left of the confidence in a class whose size an object hasn't"
    )


class ObjectConfig(_Part):
    """Object map: points, association (eq. 3), confirmation and false positives."""

    points: PointsConfig = Field(default=PointsConfig(), description="masks to points")
    association: AssociationConfig = Field(default=AssociationConfig(), description="detections to objects")
    confirmation: ConfirmationConfig = Field(
        default=ConfirmationConfig(), description="candidates to confirmed objects"
    )
    false_positives: FalsePositiveConfig = Field(default=FalsePositiveConfig(), description="objects to rejected ones")
    max_objects: int = Field(default=1000, ge=1, description="of a floor; the weakest candidates go first")
    max_voxels: int = Field(default=6000, ge=1, description="of an object")
    max_history: int = Field(default=64, ge=1, description="events kept with an object")


class FusionConfig(_Part):
    """All of it."""

    map: MapConfig = Field(default=MapConfig(), description="point cloud, obstacles, exploration, frontiers")
    value: ValueConfig = Field(default=ValueConfig(), description="value map")
    objects: ObjectConfig = Field(default=ObjectConfig(), description="object map")
    validation: ValidationConfig = Field(default=ValidationConfig(), description="which views are refused")
    views: ViewOrderConfig = Field(default=ViewOrderConfig(), description="which camera views come first")

    @classmethod
    def preset(cls, name: Literal["default", "paper"]) -> FusionConfig:
        """``paper``: the paper to the letter (VLN-Game where it is silent); ``default``: what works best here."""
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
        """With the settings of ``changes``, nested as the parts are. ValidationError: a name or a value that can't be."""
        return FusionConfig.model_validate(_merged(self.model_dump(), changes))


def _merged(under: Mapping[str, Any], over: Mapping[str, Any]) -> dict[str, Any]:
    """``under`` with the values of ``over``, level by level."""
    both = dict(under)
    for key, value in over.items():
        nested = isinstance(value, Mapping) and isinstance(both.get(key), Mapping)
        both[key] = _merged(both[key], value) if nested else value
    return both
