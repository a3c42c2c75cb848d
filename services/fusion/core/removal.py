"""Takes what one source has contributed out of the joint maps, as far as they know whose it is.

Voxels know who has seen them, kept embeddings whose view they are of, and objects who has detected them. Counts per cell and
means over several sources don't say whose share is what. So this is the second choice, where the maps can't be computed again
without the source:

- Voxels that nobody else has seen are gone, and so are the counts of cells in which no other voxel is left. Where no voxel is
  left at heights that block, what blocked there is gone. Voxels that others have seen too keep their mean.
- Floor that rays have passed over without any voxel stays explored, and estimated depth stays counted.
- Objects that nobody else has detected are gone. Of others, the evidence by the source is gone where it is kept apart.
- Embeddings and free depths of its views are gone, and so is a floor of which nothing is left.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from surveilnav.services.fusion.core.config import FusionConfig, MapConfig
from surveilnav.services.fusion.core.joint_map import JointMap
from surveilnav.services.fusion.core.maps.cloud import voxel_centres
from surveilnav.services.fusion.core.maps.voxels import NEVER
from surveilnav.services.fusion.core.objects.confirmation import confirmation_rule
from surveilnav.services.fusion.core.objects.evidence import Evidence


@dataclass(frozen=True, slots=True)
class Contribution:
    """What is removed: everything of a source, or its views of a span of stamps [ns], both ends included."""

    source: str
    since_ns: int | None = None
    until_ns: int | None = None

    @property
    def is_whole(self) -> bool:
        return self.since_ns is None and self.until_ns is None

    @property
    def low_ns(self) -> int:
        """The beginning of the span; without one, before all stamps."""
        return -(2**63) if self.since_ns is None else self.since_ns

    @property
    def high_ns(self) -> int:
        """The end of the span; without one, after all stamps."""
        return 2**63 - 1 if self.until_ns is None else self.until_ns

    def covers(self, first_ns: int, last_ns: int) -> bool:
        """Whether everything that was seen from one time to another [ns] lies in the span."""
        return self.low_ns <= first_ns and last_ns <= self.high_ns

    def overlaps(self, first_ns: int, last_ns: int) -> bool:
        """Whether anything that was seen from one time to another [ns] may lie in the span."""
        return self.low_ns <= last_ns and first_ns <= self.high_ns

    def includes(self, source: str, stamp_ns: int) -> bool:
        """Whether a view of a source that was taken at a time [ns] is part of it."""
        return source == self.source and self.covers(stamp_ns, stamp_ns)


def sources_to_remove(joint: JointMap) -> list[str]:
    """The cameras in quarantine whose views the maps hold nevertheless: these came before it was known."""
    reasons = joint.quarantine.reasons()
    return sorted(reasons.keys() & joint.validator.sources()) if reasons else []


def without(joint: JointMap, removed: Contribution) -> JointMap:
    """A copy of the joint maps without a contribution, at the next revision."""
    state = joint.state()
    revision = state["revision"] = state["revision"] + 1
    _remove_from_validator(state["validator"], removed)
    if removed.is_whole:
        state["climbs"].pop(removed.source, None)
    for maps in state["floors"]:
        _remove_from_geometry(maps["geometry"], removed, joint.config.map)
        maps["geometry"]["revision"] = revision
        views = maps["value"]["views"]
        kept_views = [row for row in views if not removed.includes(row[0], row[3].stamp_ns)]
        maps["value"]["views"] = [[*row[:3], _plain(row[3])] for row in kept_views]
        objects = maps["objects"]["objects"]
        maps["objects"]["objects"] = [o for o in objects if _remove_from_object(o, removed, joint.config)]
    state["floors"] = [maps for maps in state["floors"] if not _is_empty(maps)]
    kept = {maps["geometry"]["floor"] for maps in state["floors"]}
    state["name_of"] = {name: floor for name, floor in state["name_of"].items() if floor in kept}
    return JointMap.from_state(state, joint.config)


def _plain(view: Any) -> dict[str, Any]:
    return {name: getattr(view, name) for name in view.__dataclass_fields__}


def _remove_from_validator(state: dict[str, Any], removed: Contribution) -> None:
    for name in ("last", "doubted"):
        state[name] = [row for row in state[name] if not removed.includes(row[0], row[2]["stamp_ns"])]
    if removed.is_whole:
        state["last_seq"].pop(removed.source, None)
        state["missed"].pop(removed.source, None)


def _remove_from_geometry(state: dict[str, Any], removed: Contribution, config: MapConfig) -> None:
    """Removes voxels, what cells counted of them, and free depths."""
    voxels, sets = state["cloud"]["voxels"], state["cloud"]["sets"]
    is_alone = np.array([members == [removed.source] for members in sets])[voxels["sources"]]
    gone = is_alone & (voxels["first_ns"] >= removed.low_ns) & (voxels["last_ns"] <= removed.high_ns)
    if removed.is_whole:
        _remove_from_sets(state["cloud"], removed.source)
    keys = voxels["key"]
    centres_m, rows, cols = _cells(keys, state, config)
    shape = state["layers"]["visited"].shape
    inside = (rows >= 0) & (rows < shape[0]) & (cols >= 0) & (cols < shape[1])
    height_m = centres_m[:, 2] - state["z_m"]
    blocks = (height_m >= config.obstacle_min_m) & (height_m <= config.obstacle_max_m)
    touched, left, left_blocking = (
        _mask(shape, rows[which & inside], cols[which & inside]) for which in (gone, ~gone, ~gone & blocks)
    )
    carved = _is_carved(voxels, config)
    present = _count(shape, rows, cols, inside & ~gone & blocks & ~carved)
    state["layers"]["voxels_present"] = np.where(touched, present, state["layers"]["voxels_present"]).astype(np.int32)
    now_carved = _count(shape, rows, cols, inside & ~gone & blocks & carved)
    state["layers"]["voxels_carved"] = np.where(touched, now_carved, state["layers"]["voxels_carved"]).astype(np.int32)
    if gone.all():  # nobody else has measured anything on this floor
        touched[:] = True
    for name, counts in state["counts"]["measured"].items():
        counts[touched & ~left] = 0
        if name.startswith("obstacle"):
            counts[touched & ~left_blocking] = 0
    for name in voxels:
        voxels[name] = voxels[name][~gone]
    images = state["free_depths"]["images"]
    state["free_depths"]["images"] = [i for i in images if not removed.includes(i["order"][1], i["order"][0])]
    others = {m for number in np.unique(voxels["sources"]) for m in sets[number]} - {removed.source}
    if removed.is_whole and removed.source.startswith("robot/") and not any(m.startswith("robot/") for m in others):
        for name in ("visited", "scan_hits", "scan_passes"):
            state["layers"][name][:] = 0  # no other robot was ever here


def _remove_from_sets(cloud: dict[str, Any], source: str) -> None:
    """Gives voxels that others have seen too the number of the set without the source."""
    sets = cloud["sets"]
    numbers = {tuple(members): k for k, members in enumerate(sets)}
    renumbered = np.arange(len(sets))
    for k, members in enumerate(list(sets)):
        if source in members:
            rest = tuple(m for m in members if m != source)
            if rest not in numbers:
                numbers[rest] = len(sets)
                sets.append(list(rest))
            renumbered[k] = numbers[rest]
    cloud["voxels"]["sources"] = renumbered[cloud["voxels"]["sources"]].astype(np.uint32)


def _remove_from_object(state: dict[str, Any], removed: Contribution, config: FusionConfig) -> bool:
    """Removes a source's evidence from an object; returns whether the object remains."""
    if removed.source not in state["sources"]:
        return True
    if state["sources"] == [removed.source]:
        return not removed.covers(state["first_seen_ns"], state["last_seen_ns"])
    if not removed.is_whole:
        return True  # evidence isn't kept by time
    kind = removed.source.partition("/")[0]
    state["sources"] = [s for s in state["sources"] if s != removed.source]
    state["history"] = [event for event in state["history"] if event.source != removed.source]
    state["estimated"] = [row for row in state["estimated"] if row[0] != removed.source]
    is_last = not any(s.startswith(f"{kind}/") for s in state["sources"])
    evidence = state["evidence"]
    if kind == "camera":
        evidence["by_direction"] = [row for row in evidence["by_direction"] if row[1] != removed.source]
    elif is_last:  # robots' evidence is kept by where they stood, not by their name
        evidence["by_direction"] = [row for row in evidence["by_direction"] if row[0] != "robot"]
        evidence["misses"] = 0
    if is_last:
        evidence["robot" if kind == "robot" else "surveillance"] = {}
    if not evidence["by_direction"]:
        return False
    rule, of_others = confirmation_rule(config.objects), Evidence.from_state(evidence)
    rule.update(of_others)
    result = rule.assess(of_others, state["status"])
    state["evidence"] = of_others.state()
    state["label"], state["confidence"], state["reason"] = result.label, result.confidence, result.reason
    # size and certainty of the place were checked when it was confirmed; the next view checks them again
    state["status"] = "candidate" if result.status == "confirmed" != state["status"] else result.status
    return True


def _is_empty(maps: dict[str, Any]) -> bool:
    geometry = maps["geometry"]
    counts = [layer for of_kind in geometry["counts"].values() for layer in of_kind.values()]
    seen = len(geometry["cloud"]["voxels"]["key"]) or any(
        layer.any() for layer in (*counts, geometry["layers"]["visited"])
    )
    return not (seen or maps["value"]["views"] or maps["objects"]["objects"])


def _cells(
    keys: NDArray[np.int64], state: dict[str, Any], config: MapConfig
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64]]:
    """Centres (N, 3) [m, world] of voxels, and row and column (N,) of the cells that they lie in."""
    centres_m = voxel_centres(keys, config.voxel_m)
    rows = np.floor(centres_m[:, 1] / config.resolution_m).astype(np.int64) - state["row0"]
    cols = np.floor(centres_m[:, 0] / config.resolution_m).astype(np.int64) - state["col0"]
    return centres_m, rows, cols


def _mask(shape: tuple[int, ...], rows: NDArray[np.int64], cols: NDArray[np.int64]) -> NDArray[np.bool_]:
    mask = np.zeros(shape, np.bool_)
    mask[rows, cols] = True
    return mask


def _count(
    shape: tuple[int, ...], rows: NDArray[np.int64], cols: NDArray[np.int64], which: NDArray[np.bool_]
) -> NDArray[np.int64]:
    counts = np.zeros(shape, np.int64)
    np.add.at(counts, (rows[which], cols[which]), 1)
    return counts


def _is_carved(voxels: dict[str, NDArray[Any]], config: MapConfig) -> NDArray[np.bool_]:
    deciding = {0: None, 1: "seen_through_ns", 2: "seen_through_before_ns"}[config.carve_views]
    return np.zeros(len(voxels["key"]), np.bool_) if deciding is None else np.asarray(voxels[deciding] != NEVER)
