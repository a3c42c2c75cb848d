"""What is known of one run, and what of it goes into ``run.json``."""

from __future__ import annotations

import math
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from surveilnav.geometry import Grid
from surveilnav.messages import CameraInfo, MissionStatus, ObjectRecord, Plan, TrafficReport
from surveilnav.occupancy import PRIOR_FREE
from surveilnav.services.gateway.core.traffic import sum_traffic
from surveilnav.words import canonical

#: By name: its grid and its cells (rows, cols).
Layers = dict[str, tuple[Grid, NDArray]]


class Step(NamedTuple):
    """Where the robot was after an action, or at the start [m, world], and what it saw there.

    ``seq``: number of the observation; ``t_s``: when it came, since the mission began; ``path_m``: walked so far;
    ``jpeg``: its picture, empty if none is kept; ``action``: what led here.
    """

    x_m: float
    y_m: float
    floor: str
    seq: int = 0
    stamp_ns: int = 0
    t_s: float = 0.0
    yaw_rad: float = 0.0
    path_m: float = 0.0
    action: str = ""
    collided: bool = False
    jpeg: bytes = b""


class MapMoment(NamedTuple):
    """What a floor's map held when it had observation ``seq``; ``packed`` as by ``pack``, as hundreds of them are kept."""

    seq: int
    floor: str
    grid: Grid
    packed: bytes

    @staticmethod
    def pack(explored: NDArray[np.uint8], occupancy: NDArray[np.uint8]) -> bytes:
        """Both layers (rows, cols) as one of 0 (unknown), 1 (explored) or 2 (obstacle), compressed."""
        is_obstacle = (occupancy != 0) & (occupancy != PRIOR_FREE)
        cells = np.where(is_obstacle, 2, explored != 0).astype(np.uint8)
        return zlib.compress(cells.tobytes(), 1)

    @property
    def cells(self) -> NDArray[np.uint8]:
        """The states (rows, cols)."""
        return np.frombuffer(zlib.decompress(self.packed), np.uint8).reshape(self.grid.shape)


class DecidingView(NamedTuple):
    """A view that decided: its JPEG and detections (x0, y0, x1, y1 [px], label, score)."""

    caption: str
    jpeg: bytes
    boxes: Sequence[tuple[float, float, float, float, str, float]]


class TrafficLine(NamedTuple):
    """Bytes of a camera, robot or service.

    ``offered``: what it put or asked. ``delivered``: for a camera or robot, what the others got under its keys; for
    a service, what it got. ``wire``: sent by its sockets as the kernel counts it, None if unknown.
    """

    name: str
    kind: Literal["camera", "robot", "service"]
    offered: int
    delivered: int
    wire: int | None


@dataclass
class RunRecord:
    """All that is known of one run.

    Attributes:
        perception, perception_why: the backend that ran, and why that one.
        status: the mission's last status; None if the run ended before there was one.
        verdict: the simulator's check: found, success, steps, spl, path_m, shortest_path_m,
            distance_to_viewpoint_m, ...; what is missing is taken from ``status`` or left out.
        layers: floor -> layer -> (grid, cells): occupancy, explored, frontier uint8; value float32 with NaN.
        invoked: names of the cameras that fusion subscribed to.
        objects: the object map of all floors at the end.
        map_moments: the maps as they grew.
        room: the room of what was found, if the building names it.
        actions: what the robot did, one after the other.
    """

    building: str
    seed: int
    target: str
    perception: str
    perception_why: str
    surveillance: bool
    started: datetime
    seconds: float
    status: MissionStatus | None = None
    verdict: dict[str, Any] = field(default_factory=dict)
    trajectory: Sequence[Step] = ()
    plans: Sequence[Plan] = ()
    layers: dict[str, Layers] = field(default_factory=dict)
    cameras: Sequence[CameraInfo] = ()
    invoked: Sequence[str] = ()
    objects: Sequence[ObjectRecord] = ()
    deciding_views: Sequence[DecidingView] = ()
    traffic: Sequence[TrafficLine] = ()
    notes: Sequence[str] = ()
    map_moments: Sequence[MapMoment] = ()
    room: str = ""
    actions: Sequence[str] = ()

    @property
    def found(self) -> bool:
        """The planner confirmed a target and stopped."""
        ended_well = self.status is not None and self.status.found and self.status.state == "done"
        return bool(self.verdict.get("found", ended_well))

    @property
    def success(self) -> bool:
        """The simulator agrees."""
        return bool(self.verdict.get("success", False))

    def number(self, name: str) -> float | None:
        """A number of the verdict or, for steps and path_m, of the status; None if unknown or not finite."""
        fallback = {"steps": "step", "path_m": "path_m"}.get(name)
        value = self.verdict.get(name, getattr(self.status, fallback, None) if fallback else None)
        return float(value) if isinstance(value, (int, float)) and math.isfinite(value) else None

    @property
    def search_s(self) -> float | None:
        """From the mission's start to its end, by the planner's clock; else by when pictures came; None if unknown."""
        status = self.status
        if status is not None and 0 < status.started_ns < status.finished_ns:
            return (status.finished_ns - status.started_ns) / 1e9
        spent_s = self.trajectory[-1].t_s - self.trajectory[0].t_s if self.trajectory else 0.0
        return spent_s if 0.0 < spent_s < math.inf else None

    @property
    def first_action_s(self) -> float | None:
        """From the mission's start to the first plan, by the planner's clock; None if unknown."""
        status, first_ns = self.status, min((plan.stamp_ns for plan in self.plans), default=0)
        return (
            (first_ns - status.started_ns) / 1e9 if status is not None and 0 < status.started_ns <= first_ns else None
        )

    @property
    def chosen(self) -> ObjectRecord | None:
        """The object that the robot went to."""
        id = self.status.object_id if self.status is not None else None
        return next((o for o in self.objects if o.id == id), None)

    @property
    def totals(self) -> dict[str, int | None]:
        """Bytes offered, delivered and on the wire (sent), over all lines."""
        wire = [line.wire for line in self.traffic if line.wire is not None]
        return {
            "offered": sum(line.offered for line in self.traffic),
            "delivered": sum(line.delivered for line in self.traffic),
            "wire": sum(wire) if wire else None,
        }


def candidates_of(record: RunRecord) -> list[ObjectRecord]:
    """Objects that anybody ever took for the target: what is called so now first, then confirmed, then by confidence."""
    target = canonical(record.target)

    def taken_for_it(o: ObjectRecord) -> bool:
        """Whether any source or detection ever called it so."""
        names = {o.label, o.label_robot, o.label_surveillance, *o.label_scores, *(e.label for e in o.history)}
        return target in {canonical(n) for n in names if n}

    order = {"confirmed": 0, "candidate": 1, "rejected": 2}
    chosen = record.status.object_id if record.status else None
    return sorted(
        (o for o in record.objects if taken_for_it(o)),
        key=lambda o: (
            o.id != chosen,
            canonical(o.label) != target,
            order[o.status],
            -o.confidence if math.isfinite(o.confidence) else 0.0,
            o.id,
        ),
    )


def first_seen_by(record: ObjectRecord) -> str:
    """The source that saw an object first ("camera/c3"); empty if its history doesn't say."""
    return next((e.source for e in record.history if e.what != "not_seen"), "")


def traffic_lines(reports: Iterable[TrafficReport]) -> list[TrafficLine]:
    """The report's rows from what every node counted: cameras, robots, then services."""
    sums = sum_traffic(reports)
    lines = [TrafficLine(s.id, "camera", s.offered_bytes, s.delivered_bytes, s.wire_sent_bytes) for s in sums.cameras]
    lines += [TrafficLine(s.id, "robot", s.offered_bytes, s.delivered_bytes, s.wire_sent_bytes) for s in sums.robots]
    sources = {s.node for s in (*sums.cameras, *sums.robots)}
    for n in sums.nodes:
        if f"{n.kind}/{n.id}" not in sources:
            name = n.id if n.id.startswith(n.kind) else f"{n.kind} {n.id}"
            lines.append(TrafficLine(name, "service", n.offered_bytes, n.delivered_bytes, n.wire_sent_bytes))
    return lines


def run_json(record: RunRecord, report: Path | None = None) -> dict[str, Any]:
    """The run as plain JSON values; numbers that are unknown or not finite are null."""
    steps = record.number("steps")
    status = record.status
    rest = {k: plain(v) for k, v in record.verdict.items()}
    return rest | {
        "building": record.building,
        "seed": record.seed,
        "target": record.target,
        "found": record.found,
        "success": record.success,
        "state": status.state if status else None,
        "error": (status.error or None) if status else None,
        "message": status.message if status else "",
        "steps": int(steps) if steps is not None else None,
        "spl": record.number("spl"),
        "path_m": record.number("path_m"),
        "shortest_path_m": record.number("shortest_path_m"),
        "seconds": round(record.seconds, 3),
        "search_s": plain(record.search_s),
        "first_action_s": plain(record.first_action_s),
        "actions": list(record.actions),
        "started": record.started.isoformat(),
        "perception": record.perception,
        "perception_why": record.perception_why,
        "surveillance": record.surveillance,
        "cameras": len(record.cameras),
        "invoked_cameras": sorted(record.invoked),
        "traffic": record.totals,
        "notes": list(record.notes),
        "report": str(report) if report else None,
    }


def plain(value: Any) -> Any:
    """``value`` as JSON can carry it; null where it is no finite number."""
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    return value if isinstance(value, (str, int, bool, type(None))) else str(value)
