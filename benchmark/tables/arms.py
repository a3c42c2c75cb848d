"""Every table as the runs that it compares. The first arm of a table is what the others are compared with."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from operator import itemgetter
from typing import Any

import msgspec

from surveilnav.benchmark.runner.settings import RunSettings
from surveilnav.services.fusion.core.objects.config import AssociationConfig


@dataclass(frozen=True, slots=True)
class Arm:
    """One line of a table.

    Attributes:
        paper: what the paper has for it (SR, SPL), None: nothing.
        seeds: it is played with so many, from its settings' on; the line is of them all.
        levels: which of each of its table's factors it has.
    """

    label: str
    settings: RunSettings
    paper: tuple[float, float] | None = None
    seeds: int = 1
    levels: tuple[str, ...] = ()

    @property
    def runs(self) -> tuple[RunSettings, ...]:
        """One for each seed."""
        first = self.settings.seed
        return tuple(msgspec.structs.replace(self.settings, seed=first + n) for n in range(self.seeds))


@dataclass(frozen=True, slots=True)
class Table:
    """``about``: what is compared, for the page. ``over_bytes``: its plot also shows SPL over what the cameras sent.
    ``factors``: what its arms combine; the page also tells the levels of each apart. ``explained``: the page also says
    which searches make the differences in SPL."""

    name: str
    title: str
    about: str
    arms: tuple[Arm, ...]
    over_bytes: bool = False
    factors: tuple[str, ...] = ()
    explained: bool = False


def _run(split: str = "val_mini", **settings: Any) -> RunSettings:
    return RunSettings(split=split, **settings)


def _main() -> Table:
    others = [
        ("random walk", "random-walk", (0.0, 0.0)),
        ("random samples", "random-samples", (30.0, 14.3)),
        ("nearest frontier", "frontier", (23.7, 12.3)),
        ("VLFM's rule", "vlfm", (64.0, 32.7)),
        ("VLFM's rule, our verification", "vlfm-verified", None),
        ("L3MVN's rule", "l3mvn", (50.4, 23.1)),
        ("L3MVN's rule, our verification", "l3mvn-verified", None),
        ("ApexNav's rule", "apexnav", None),
    ]
    ours = [
        Arm("ours, with surveillance, FMM", _run("val"), (67.4, 34.5)),
        Arm("ours, without surveillance, FMM", _run("val", surveillance=False), (62.7, 26.1)),
        Arm("ours, with surveillance, SP", _run("val", planner="sp"), (71.1, 36.4)),
        Arm("ours, without surveillance, SP", _run("val", planner="sp", surveillance=False), (68.7, 28.0)),
        Arm("the paper to the letter, with surveillance, FMM", _run("val", policy="surveilnav-paper"), (67.4, 34.5)),
    ]
    bounds = [Arm("shortest path, same actions", _run("val", policy="shortest-path", surveillance=False))]
    baselines = [Arm(label, _run("val", policy=p, surveillance=False), paper) for label, p, paper in others]
    return Table(
        "main",
        "Main comparison",
        "Baselines search without cameras, on the same maps and with the same perception. Those of VLFM, L3MVN and ApexNav "
        "believe as their papers say, with `our verification` only where the robot explores is theirs.",
        (*ours, *baselines, *bounds),
    )


def _rules() -> Table:
    methods = (
        ("CoW", "cow"),
        ("VLFM", "vlfm"),
        ("L3MVN", "l3mvn"),
        ("ESC", "esc"),
        ("VoroNav", "voronoi"),
        ("ApexNav", "apexnav"),
    )
    arms = [Arm("ours", _run(surveillance=False)), Arm("nearest frontier", _run(policy="frontier", surveillance=False))]
    for name, policy in methods:
        arms += [
            Arm(f"{name}'s rule", _run(policy=policy, surveillance=False)),
            Arm(f"{name}'s rule, our verification", _run(policy=f"{policy}-verified", surveillance=False)),
        ]
    return Table(
        "rules",
        "Rules that choose frontiers",
        "All without cameras, on the same maps and with the same perception. A rule alone believes as its paper says; with `our "
        "verification` only where the robot explores is its own. Where a method asks a language model, how often classes of "
        "objects share a room in homes of `train` stands in.",
        tuple(arms),
    )


def _pixels() -> Table:
    return Table(
        "pixels",
        "On pixels",
        "Our own network `compact` looks at rendered pixels; planner FMM. Beside it the pair of COCO detectors.",
        (
            Arm("compact, with surveillance", _run("val", perception="compact")),
            Arm("compact, without surveillance", _run("val", perception="compact", surveillance=False)),
            Arm("onnx-coco, with surveillance", _run("val", perception="onnx-coco")),
        ),
        explained=True,
    )


def _agreement() -> tuple[Table, Table]:
    """A detector errs in one way; the error model in as many as there are seeds, and each thing's luck lasts a whole run."""
    about = "Whether the calibrated error model stands for the real detector: the same searches, of the model with four seeds."

    def table(name: str, title: str, on: bool) -> Table:
        return Table(
            name,
            title,
            about,
            (
                Arm("compact on pixels", _run(perception="compact", surveillance=on)),
                Arm("simulated, mean of four seeds", _run(surveillance=on), seeds=4),
                *(Arm(f"simulated, seed {n}", _run(surveillance=on, seed=n)) for n in range(4)),
            ),
        )

    return (
        table("agreement", "Simulated against pixels, with cameras", True),
        table("agreement-alone", "Simulated against pixels, without cameras", False),
    )


_BY_IOU: dict[str, Any] = {"tau": 1.1, "tau_mutual": None}
_GEOMETRIES: dict[str, dict[str, Any]] = {
    # an IoU of what two views see of one thing is small where an overlap is near 1, so its threshold is lower
    "overlap": {},
    "box IoU": {"geometry": "box_iou", **_BY_IOU},
    "voxel IoU": {"geometry": "voxel_iou", **_BY_IOU},
}
_FUSIONS = ("confidence", "average", "latest")
_STRATEGIES = ("places", "region", "object", "greedy")


def _components() -> Table:
    """All combinations; those with fewest changes come first, so that a table half played says most."""
    arms = []
    for geometry, fusion, strategy in product(_GEOMETRIES, _FUSIONS, _STRATEGIES):
        maps: dict[str, Any] = {}
        if objects := _GEOMETRIES[geometry]:
            maps["objects"] = {"association": objects}
        if fusion != _FUSIONS[0]:
            maps["value"] = {"fusion": fusion}
        planning = {"strategy": strategy} if strategy != _STRATEGIES[0] else {}
        n, levels = len(maps) + len(planning), (geometry, fusion, strategy)
        label = ", ".join(levels) + " (default)" * (n == 0)
        arms.append((n, Arm(label, _run(fusion=maps, planning=planning), levels=levels)))
    return Table(
        "components",
        "Association x value fusion x strategy",
        "How two views of a thing are compared, how the values of several views of a place become one, and what ranks "
        "frontiers. An overlap is near 1 where two views see parts of one thing, an IoU is small: looks and place must "
        f"reach {AssociationConfig().tau:g} with overlap and {_BY_IOU['tau']:g} with an IoU, and overlap both ways makes one "
        "object of two, at once or later, only with overlap. With `places`, `object` and `greedy`, values decide only "
        "where to look around once more when all is explored.",
        tuple(arm for _, arm in sorted(arms, key=itemgetter(0))),
        factors=("association geometry", "value fusion", "strategy"),
    )


TABLES: dict[str, Table] = {
    t.name: t
    for t in (
        _main(),
        _rules(),
        _pixels(),
        _components(),
        Table(
            "range",
            "Perception range of the cameras",
            "Half: six neighbouring azimuths, where most is to be seen.",
            (
                Arm("360 degrees", _run(), (67.4, 34.5)),
                Arm("180 degrees", _run(views="half"), (66.8, 32.1)),
                Arm("no cameras", _run(surveillance=False), (62.7, 26.1)),
            ),
        ),
        Table(
            "density",
            "Density of the cameras",
            "One camera per so much floor.",
            (
                Arm("100 m2", _run(), (67.4, 34.5)),
                Arm("200 m2", _run(density_m2=200), (66.5, 33.0)),
                Arm("no cameras", _run(surveillance=False), (62.7, 26.1)),
            ),
        ),
        Table(
            "strategy",
            "What ranks frontiers",
            "Ours and the paper's three, with the planner SP as there.",
            (
                Arm("places", _run(planner="sp")),
                Arm("region", _run(planner="sp", planning={"strategy": "region"}), (71.1, 36.4)),
                Arm("object", _run(planner="sp", planning={"strategy": "object"}), (70.5, 35.8)),
                Arm("greedy", _run(planner="sp", planning={"strategy": "greedy"}), (69.0, 35.6)),
            ),
        ),
        Table(
            "strategy-pixels",
            "What ranks frontiers, on pixels",
            "As `strategy`, but real detectors look; planner FMM.",
            (
                Arm("places", _run(perception="onnx-coco")),
                Arm("region", _run(perception="onnx-coco", planning={"strategy": "region"})),
                Arm("object", _run(perception="onnx-coco", planning={"strategy": "object"})),
                Arm("greedy", _run(perception="onnx-coco", planning={"strategy": "greedy"})),
            ),
        ),
        Table(
            "detector",
            "Perception",
            "Real detectors on rendered pixels (`compact`; beside YOLOX-nano, PicoDet-S looks at the robot's views and DEIMv2 "
            "femto at the cameras'), the calibrated error model, the truth.",
            (
                Arm("compact", _run(perception="compact")),
                Arm("simulated", _run()),
                Arm("onnx-coco: YOLOX-nano and another", _run(perception="onnx-coco")),
                Arm("onnx-coco: DEIMv2 femto alone", _run(perception="onnx-coco", detectors=["deimv2-femto"])),
                Arm("oracle: the truth", _run(perception="oracle")),
            ),
        ),
        *_agreement(),
        Table(
            "tiers",
            "Bytes against success",
            "Counted by the real encoders on rendered pixels; bytes an episode.",
            (
                Arm("frames (JPEG + depth)", _run(perception="onnx-coco")),
                Arm("frames, half the views", _run(perception="onnx-coco", views="half")),
                Arm("frames, half the cameras", _run(perception="onnx-coco", density_m2=200)),
                Arm("none", _run(perception="onnx-coco", surveillance=False)),
            ),
            over_bytes=True,
        ),
        Table(
            "delay",
            "Late cameras",
            "Actions between a camera's invocation and the arrival of its views. A search begins with a look around, so the "
            "first ways are decided after 12 actions or more: what comes before then comes early enough.",
            tuple(Arm(f"{n} steps", _run(delay_steps=n)) for n in (0, 1, 5, 10, 20, 40)),
        ),
        Table(
            "errors",
            "Worse and better perception",
            "True things so many standard deviations of luck harder to find and name, false alarms as much easier to give.",
            tuple(
                Arm(f"{k:+g}, {'with' if on else 'without'} cameras", _run(harder=k, surveillance=on))
                for on in (True, False)
                for k in (0.0, -1.0, -0.5, 0.5, 1.0)
            ),
        ),
        Table(
            "poses",
            "Badly surveyed cameras",
            "Each camera's pose is wrong by this much in a direction drawn for it.",
            tuple(
                Arm(f"{cm} cm, {deg:g} degrees", _run(camera_error_m=cm / 100, camera_error_deg=deg))
                for cm, deg in ((0, 0.0), (2, 0.5), (5, 1.0), (10, 3.0))
            ),
        ),
    )
}
