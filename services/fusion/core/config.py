"""Every number of the joint maps. Metres, radians, counts; where it says so, the paper's or a peer's value."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field

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
        default=1.0, gt=0, description="a robot that went so far on one level isn't on a stair but on a storey"
    )
    level_views: int = Field(default=8, ge=1, description="... or looked so often from it, under a new floor name")
    resolution_m: float = Field(default=0.05, gt=0)
    extent_m: float = Field(default=24.0, gt=0, description="side of a new map; maps grow")
    max_extent_m: float = Field(
        default=150.0, gt=0, description="a map never grows past this: remote poses are hostile"
    )
    max_floors: int = Field(default=64, ge=1)
    voxel_m: float = Field(default=0.025, gt=0)
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
    max_range_robot_m: float = Field(default=5.0, gt=0)
    max_range_camera_m: float = Field(default=10.0, gt=0)
    depth_edge: float = Field(
        default=0.05, gt=0, description="a pixel whose neighbours differ by more than this share is a flying one"
    )
    obstacle_min_m: float = Field(default=0.12, description="lowest height above the floor that blocks")
    obstacle_max_m: float = Field(default=1.1, description="highest height above the floor that blocks")
    obstacle_noise_per_m: float = Field(
        default=0.002, ge=0, description="raises obstacle_min_m by this times range^2: depth noise"
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
    robot_radius_m: float = Field(default=0.18, ge=0, description="where a robot stands is free")
    frontier: Literal["boundary", "literal"] = "boundary"
    frontier_dilation_m: float = Field(default=0.15, ge=0)
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


class GuardConfig(_Part):
    """What the next view of a source can't be."""

    max_step_m: float = Field(
        default=2.0, gt=0, description="a robot moves no farther from one observation to the next"
    )
    climb_m: float = Field(default=0.4, gt=0, description="a change of altitude beyond this is a stair or a lift")
    max_sources: int = Field(default=100_000, ge=1, description="views of sources that are remembered")


#: Settings of ``ObjectConfig`` by which ``confirm_score`` alone decides, whatever the class and the other classes.
ONE_RULE_FOR_ALL: dict[str, Any] = {
    "confirm_scores": {}, "confirm_early": 0.0, "confirm_margin": 0.0, "confirm_margins": {}, "confirm_detections": {},
}  # fmt: skip


class ObjectConfig(_Part):
    """Object map: association (eq. 3), fusion and confirmation."""

    # masks to points
    max_points: int = Field(default=1000, ge=20, description="pixels of a mask that are back-projected")
    max_range_robot_m: float = Field(default=5.0, gt=0)
    max_range_camera_m: float = Field(default=8.0, gt=0)
    dbscan_eps_m: float = Field(default=0.05, gt=0)
    dbscan_min_points: int = Field(default=10, ge=1)
    dbscan_eps_pixels: float = Field(
        default=3.0, ge=0, description="eps is at least so many sample distances; 0: the paper's fixed eps"
    )
    min_points: int = Field(default=12, ge=1, description="smaller clusters are dropped")
    min_score: float = Field(default=0.25, ge=0, le=1, description="weaker detections are not looked at")
    # association, eq. 3
    geometry: GeometricSimilarity = "overlap"
    w_visual: float = Field(default=1.0, ge=0)
    w_geometric: float = Field(default=1.0, ge=0)
    tau: float = Field(
        default=1.3,
        description="for overlap: docs/results/association (ConceptGraphs: 1.2); the paper's 1.35 is for box_iou",
    )
    tau_mutual: float = Field(
        default=0.3, description="overlap both ways that makes one object of two whatever their looks; > 1: off"
    )
    overlap_voxel_m: float = Field(default=0.05, gt=0, description="points within one such voxel of each other overlap")
    once_per_view: bool = Field(
        default=True, description="an object takes one detection of a class from a picture; False: eq. 3 to the letter"
    )
    merge_every: int = Field(default=5, ge=1, description="views between two searches for duplicates")
    merge_overlap: float = Field(default=0.6, ge=0)
    merge_box: float = Field(
        default=0.5, ge=0, description="share of the smaller box inside the larger that merges alikes"
    )
    merge_visual: float = Field(default=0.55, ge=-1)
    max_objects: int = Field(default=1000, ge=1, description="of a floor; the weakest candidates go first")
    max_voxels: int = Field(default=6000, ge=1, description="of an object")
    max_history: int = Field(default=64, ge=1, description="events kept with an object")
    # confirmation
    near_m: float = Field(default=3.5, gt=0, description="a robot's detection within this range can confirm")
    confirm_score: float = Field(
        default=0.5, ge=0, le=1, description="the paper's threshold on the maximum of both confidences"
    )
    confirm_scores: dict[str, float] = Field(
        default={"bed": 0.4, "chair": 0.3, "couch": 0.32, "potted plant": 0.27, "toilet": 0.4, "tv": 0.38},
        description="classes of which a size is known need less: above this, most that fit are true, in searches of "
        "training buildings",
    )
    confirm_early: float = Field(
        default=0.08, ge=0, le=1, description="what an object needs more with the fewest sightings that can confirm it"
    )
    confirm_settled: int = Field(default=8, ge=1, description="... down to nothing with so many")
    confirm_margin: float = Field(
        default=1.25, ge=0, description="confidence in the class is at least this many times that in any other"
    )
    confirm_margins: dict[str, float] = Field(
        default={"bed": 5.0, "couch": 1.0},
        description="the same by class: what is most of all a couch is one, 14 of 15 times; what is taken for a bed and "
        "now and then for a couch is a couch, 7 of 12 times, and none of 34 beds is taken for one",
    )
    min_detections: int = Field(
        default=2, ge=1, description="of the class; with fewer an object stays a candidate (ConceptGraphs, VLN-Game)"
    )
    confirm_robot_detections: int = Field(default=3, ge=1, description="near detections of the class by a robot")
    confirm_detections: dict[str, int] = Field(
        default={"bed": 6},
        description="the same by class: much looks like a bed at first; by then 4 of 5 are true, not 3",
    )
    confirm_robot_poses: int = Field(default=2, ge=1, description="... from so many places or directions")
    confirm_camera_score: float = Field(default=0.65, ge=0, le=1)
    confirm_camera_views: int = Field(default=3, ge=1, description="different camera views that saw the class")
    confirm_hysteresis: float = Field(
        default=0.8, ge=0, le=1, description="share of the threshold that keeps an object confirmed"
    )
    confidence: Literal["share", "mean"] = Field(
        default="share",
        description="of a class: over all evidence, other classes and misses counting 0, or over its own",
    )
    size_prior: bool = Field(default=True, description="only what has a size that its class can have is confirmed")
    misfit_factor: float = Field(
        default=0.5, ge=0, le=1, description="what is left of the confidence in a class whose size an object hasn't"
    )
    # false positives
    flip: Literal["sustained", "literal"] = Field(
        default="sustained", description="`literal`: any change of class rejects for good"
    )
    flip_detections: int = Field(default=3, ge=1, description="detections of the new class that make a flip")
    flip_margin: float = Field(
        default=1.2, ge=1, description="... whose weight must exceed the old class's by this factor"
    )
    revive_detections: int = Field(
        default=2, ge=1, description="detections of the new class, after a flip, that make a candidate again"
    )
    miss_near_m: float = Field(default=0.7, ge=0)
    miss_far_m: float = Field(default=3.5, gt=0)
    miss_visible: float = Field(
        default=0.7, ge=0, le=1, description="share of an object's points that must be in plain view"
    )
    miss_weight: float = Field(
        default=0.5, ge=0, description="of one missed sighting of a class that is seldom missed, in detections"
    )
    recall: dict[str, float] = Field(
        default={"potted plant": 0.4, "tv": 0.55, "chair": 0.7},
        description="in which share of plain near views detectors see a thing of the class; 0.8 of others. A miss of what "
        "is often missed says little",
    )
    reject_misses: int = Field(default=6, ge=1, description="misses that may reject")
    reject_share: float = Field(
        default=0.5, ge=0, le=1, description="... if the class was seen in less than this share of its recall"
    )


class FusionConfig(_Part):
    """All of it."""

    map: MapConfig = MapConfig()
    value: ValueConfig = ValueConfig()
    objects: ObjectConfig = ObjectConfig()
    guard: GuardConfig = GuardConfig()

    @classmethod
    def preset(cls, name: Literal["default", "paper"]) -> FusionConfig:
        """``paper``: the paper to the letter (VLN-Game where it is silent); ``default``: what works best here."""
        if name == "default":
            return cls()
        return cls(
            map=MapConfig(explored_range_camera_m=10.0), value=ValueConfig(fusion="average", half_life_s=0.0),
            objects=ObjectConfig(
                geometry="box_iou", tau=1.35, tau_mutual=2.0, once_per_view=False,
                max_points=10_000, dbscan_eps_pixels=0.0, min_points=20,
                merge_every=20, merge_overlap=0.7, merge_visual=0.7, merge_box=2.0, min_detections=2,
                flip="literal", confidence="mean",
                confirm_robot_detections=1, confirm_robot_poses=1, confirm_camera_views=1, confirm_camera_score=0.5,
                near_m=1e9, miss_weight=0.0, size_prior=False, **ONE_RULE_FOR_ALL,
                reject_misses=1_000_000_000,
            ),
        )  # fmt: skip
