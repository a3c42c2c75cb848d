"""Every number of the object map. Descriptions name the source where a value is a paper's."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from surveilnav.services.fusion.core.config_part import ConfigPart

GeometricSimilarity = Literal["box_iou", "voxel_iou", "overlap"]


class PointsConfig(ConfigPart):
    """From a detection's mask to points in the world."""

    max_points: int = Field(default=1000, ge=20, description="about this many pixels of a mask are back-projected")
    max_range_robot_m: float = Field(default=5.0, gt=0, description="farther points of robots are left out")
    max_range_camera_m: float = Field(default=8.0, gt=0, description="farther points of cameras are left out")
    dbscan_eps_m: float = Field(default=0.05, gt=0, description="DBSCAN's eps: points within it are neighbours")
    dbscan_min_points: int = Field(default=10, ge=1, description="DBSCAN's minPts: neighbours of a core point")
    dbscan_eps_pixels: float = Field(
        default=3.0,
        ge=0,
        description="eps is at least this many times the distance between sampled points; 0: the paper's fixed eps",
    )
    min_points: int = Field(default=12, ge=1, description="smaller clusters are dropped")
    min_score: float = Field(default=0.25, ge=0, le=1, description="weaker detections are dropped")
    below_floor_m: float = Field(
        default=0.5,
        ge=0,
        description="what lies lower than this below a floor is on another one, and is dropped. More than the map's `tau_z_m`",
    )


class FootPointConfig(ConfigPart):
    """From a detection in a view without depth to a place on the floor."""

    sigma_px: float = Field(default=3.0, ge=0, description="standard deviation of the lowest row of a mask")
    sigma_pose_rad: float = Field(
        default=0.009, ge=0, description="standard deviation of the direction of a calibrated camera (half a degree)"
    )
    max_range_m: float = Field(default=10.0, gt=0, description="things farther away are left out")
    max_sigma_m: float = Field(
        default=1.0, gt=0, description="... and those whose distance is more uncertain than this"
    )
    gate: float = Field(
        default=1.5, gt=0, description="two things may be one if they are within this many standard deviations"
    )
    confirm_max_sigma_m: float = Field(
        default=0.0,
        ge=0,
        description="an object that is less certain isn't confirmed; 0: only where a sensor has measured",
    )
    miss_max_sigma_m: float = Field(
        default=0.25, ge=0, description="an object that is less certain isn't missed where a robot looks"
    )


class AssociationConfig(ConfigPart):
    """Which object a detection belongs to (eq. 3), and which objects are merged."""

    geometry: GeometricSimilarity = Field(
        default="overlap", description="S_geo: IoU of boxes, IoU of voxels (the paper), or ConceptGraphs' overlap ratio"
    )
    w_visual: float = Field(default=1.0, ge=0, description="w_1 of eq. 3, the weight of S_vis (cosine of embeddings)")
    w_geometric: float = Field(default=1.0, ge=0, description="w_2 of eq. 3, the weight of S_geo")
    tau: float = Field(
        default=1.3,
        description="for overlap, measured on six homes (ConceptGraphs: 1.2); the paper's 1.35 is for box_iou",
    )
    tau_mutual: float | None = Field(
        default=0.3,
        ge=0,
        le=1,
        description="overlap in both directions from which two things are one, however different they look; None: off",
    )
    overlap_voxel_m: float = Field(
        default=0.05, gt=0, description="side of the voxels for overlaps; points in neighbouring ones overlap"
    )
    once_per_view: bool = Field(
        default=True,
        description="an object takes only one detection of a class from a picture; False: eq. 3 to the letter",
    )
    merge_every: int | None = Field(
        default=5, ge=1, description="number of views between two searches for duplicate objects; None: no search"
    )
    merge_overlap: float = Field(
        default=0.6, ge=0, description="overlap from which two objects that look alike are merged"
    )
    merge_box: float | None = Field(
        default=0.5,
        ge=0,
        le=1,
        description="... or the share of the smaller box inside the larger one from which they are; None: off",
    )
    merge_visual: float = Field(
        default=0.55, ge=-1, description="cosine of embeddings from which two objects look alike"
    )


class PaperConfirmationConfig(ConfigPart):
    """``PaperConfirmation``: a threshold on the maximum of both confidences."""

    min_confidence: float = Field(default=0.5, ge=0, le=1, description="confidence from which an object is confirmed")
    min_detections: int = Field(
        default=2,
        ge=1,
        description="detections of its class that an object needs to be confirmed (ConceptGraphs, VLN-Game)",
    )
    hysteresis: float = Field(
        default=0.8, ge=0, le=1, description="share of the threshold that keeps a confirmed object confirmed"
    )
    flip_rejects: bool = Field(default=True, description="an object whose class changes is rejected for good")


class PosteriorConfig(ConfigPart):
    """``PosteriorConfirmation``: how likely an object is of a class (``posterior``), and one threshold for all words."""

    repeat_odds: float = Field(
        default=1.7, ge=1, description="factor on the odds of a class for each further detection of it"
    )
    miss_odds: float = Field(
        default=0.45,
        gt=0,
        le=1,
        description="... and for each view that detects the object as something else, or not at all",
    )
    correlation: float = Field(
        default=0.4,
        ge=0,
        le=1,
        description="correlation of the evidence of two views from one direction, and of two directions",
    )
    min_chance: float = Field(default=0.85, gt=0, le=1, description="probability from which an object is confirmed")
    hysteresis: float = Field(
        default=0.95, ge=0, le=1, description="share of the threshold that keeps a confirmed object confirmed"
    )
    reject_chance: float = Field(
        default=0.05, ge=0, le=1, description="probability below which an object that a robot has missed is rejected"
    )


class ConfirmationConfig(ConfigPart):
    """Which rule turns candidates into confirmed objects, and the settings of both rules."""

    rule: Literal["posterior", "paper"] = Field(
        default="posterior",
        description="`posterior`: ours; `paper`: the paper's joint object confirmation to the letter",
    )
    posterior: PosteriorConfig = Field(default=PosteriorConfig(), description="settings of the rule `posterior`")
    paper: PaperConfirmationConfig = Field(
        default=PaperConfirmationConfig(), description="settings of the rule `paper`"
    )


class FalsePositiveConfig(ConfigPart):
    """What speaks against an object: misses and implausible sizes. The rule ``paper`` ignores misses."""

    miss_min_range_m: float = Field(
        default=0.7, ge=0, description="points of an object nearer to a robot's camera don't count as in plain sight"
    )
    miss_max_range_m: float = Field(default=3.5, gt=0, description="... nor do farther ones")
    miss_min_visible: float = Field(
        default=0.7,
        ge=0,
        le=1,
        description="share of an object's points in plain sight from which a view without a detection of it is a miss",
    )
    size_prior: bool = Field(
        default=True, description="only objects of a size that is possible for their class are confirmed"
    )
    size_mismatch_factor: float = Field(
        default=0.7,
        ge=0,
        le=1,
        description="factor on the confidence in a class for which an object's size is impossible",
    )


class ObjectConfig(ConfigPart):
    """Object map: points, association (eq. 3), confirmation and false positives."""

    points: PointsConfig = Field(default=PointsConfig(), description="masks to points")
    foot_point: FootPointConfig = Field(default=FootPointConfig(), description="masks to places, without depth")
    association: AssociationConfig = Field(default=AssociationConfig(), description="detections to objects")
    confirmation: ConfirmationConfig = Field(
        default=ConfirmationConfig(), description="candidates to confirmed objects"
    )
    false_positives: FalsePositiveConfig = Field(default=FalsePositiveConfig(), description="objects to rejected ones")
    max_objects: int = Field(
        default=1000, ge=1, description="objects of a floor; the weakest candidates are removed first"
    )
    max_voxels: int = Field(default=6000, ge=1, description="voxels of an object")
    max_history: int = Field(default=64, ge=1, description="newest events that are kept with an object")
